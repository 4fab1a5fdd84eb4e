//! Powers of two taken out of and put back into numbers: exact, so that sums of squares neither overflow nor
//! vanish.

use crate::TtVector;
use crate::vector::Core;
use graintrain_linalg::dense::DenseError;
use graintrain_linalg::vectorised::{Work, run_wide};
use std::borrow::Cow;

/// The largest absolute value.
///
/// # Errors
/// [`DenseError::NotFinite`] if a number is infinite or not a number.
pub(crate) fn largest_finite(data: &[f64]) -> Result<f64, DenseError> {
    let (mut largest, mut not_finite) = ([0.0; LANES], [0.0; LANES]);
    run_wide(Scan { data, largest: &mut largest, not_finite: &mut not_finite });
    if not_finite.iter().sum::<f64>() == 0.0 {
        Ok(largest.into_iter().fold(0.0, f64::max))
    } else {
        Err(DenseError::NotFinite)
    }
}

/// Numbers that are looked at together.
const LANES: usize = 8;

/// The scan of [`largest_finite`], in lanes, since maxima must not wait for one another: four times the rate
/// of a plain fold.
struct Scan<'a> {
    data: &'a [f64],
    largest: &'a mut [f64; LANES],
    /// Zero, or not a number from the first infinity or NaN on.
    not_finite: &'a mut [f64; LANES],
}

impl Work for Scan<'_> {
    #[inline(always)]
    fn run(self) {
        let Self { data, largest, not_finite } = self;
        let chunks = data.chunks_exact(LANES);
        for (lane, x) in chunks.remainder().iter().enumerate() {
            largest[lane] = x.abs();
            not_finite[lane] = x * 0.0;
        }
        for chunk in chunks {
            for lane in 0..LANES {
                let size = chunk[lane].abs();
                largest[lane] = if size > largest[lane] { size } else { largest[lane] };
                not_finite[lane] += chunk[lane] * 0.0;
            }
        }
    }
}

/// e with 2^e <= size < 2^(e + 1), kept within the exponents of normal numbers; 0 for 0.
pub(crate) fn binary_exponent(size: f64) -> i32 {
    if size > 0.0 { (size.log2().floor() as i32).clamp(-1022, 1022) } else { 0 }
}

/// Multiplies by 2^power, |power| <= 2044: in two steps, since 2^power itself may not be a normal number.
pub(crate) fn scale_by_power(data: &mut [f64], power: i32) {
    if power == 0 {
        return;
    }
    let half = f64::from(power / 2).exp2();
    let rest = f64::from(power - power / 2).exp2();
    data.iter_mut().for_each(|x| *x = *x * half * rest);
}

/// By what part a number may exceed the largest float and still be it.
const ROUNDED: f64 = 1e-13;

/// Multiplies by 2^power. Numbers that exceed the largest float by rounding only become it.
pub(crate) fn scale_within_floats(data: &mut [f64], mut power: i64) {
    while power != 0 {
        let step = power.clamp(-1000, 1000) as i32;
        power -= i64::from(step);
        let factor = f64::from(step).exp2();
        // What the factor makes the largest float (infinite for factors below one).
        let limit = if power == 0 { f64::MAX * f64::from(-step).exp2() } else { f64::INFINITY };
        let scaled = |x: f64| {
            let beyond = x.abs() > limit && x.abs() <= limit * (1.0 + ROUNDED);
            if beyond { f64::MAX.copysign(x) } else { x * factor }
        };
        data.iter_mut().for_each(|x| *x = scaled(*x));
    }
}

/// 2^power where it may be applied within a product of matrices of moderate size; none where the numbers are
/// so large or small that they have to be scaled first: a product may apply it to either factor, of which
/// small numbers must not vanish.
pub(crate) fn factor_within_product(power: i32) -> Option<f64> {
    (power.abs() <= 300).then(|| f64::from(power).exp2())
}

/// Scales the largest absolute value into [1, 2) and returns the exponent taken out; none (and nothing
/// changed) if it is zero or not finite.
pub(crate) fn factor_out(data: &mut [f64]) -> Option<i32> {
    let largest = largest_finite(data).ok().filter(|&largest| largest > 0.0)?;
    let power = binary_exponent(largest);
    scale_by_power(data, -power);
    Some(power)
}

/// Multiplies a train by 2^power: into the last core where its numbers stay normal, else the same share to
/// every core.
pub(crate) fn share_power(cores: &mut [Core], power: i64) {
    let shares = power_shares(power, cores.len());
    for (core, share) in cores.iter_mut().zip(shares) {
        scale_by_power(&mut core.data, share);
    }
}

/// The powers of two that [`share_power`] gives to each of d cores.
pub(crate) fn power_shares(power: i64, d: usize) -> Vec<i32> {
    if power.abs() <= 900 {
        let mut shares = vec![0; d];
        shares[d - 1] = power as i32;
        return shares;
    }
    equal_shares(power, d)
}

/// A power of two in equal shares for d cores.
fn equal_shares(power: i64, d: usize) -> Vec<i32> {
    let (each, extra) = (power.div_euclid(d as i64), power.rem_euclid(d as i64));
    (0..d as i64).map(|k| (each + i64::from(k < extra)).clamp(-2044, 2044) as i32).collect()
}

/// Beyond this binary exponent of a core its train is levelled before it is added to another one.
const EXTREME: i32 = 64;

/// The same train with the powers of two of its cores in equal shares, where a core is of extreme size. Two
/// trains of 1e-300 may keep it in different cores: side by side in one core these are blocks whose squares
/// have no common range. O(size of the train).
pub(crate) fn levelled(train: &TtVector) -> Cow<'_, TtVector> {
    let mut powers = Vec::with_capacity(train.cores.len());
    for core in &train.cores {
        // (A zero train, or one that is not finite, stays what it is.)
        match largest_finite(&core.data) {
            Ok(largest) if largest > 0.0 => powers.push(binary_exponent(largest)),
            _ => return Cow::Borrowed(train),
        }
    }
    if powers.iter().all(|power| power.abs() <= EXTREME) {
        return Cow::Borrowed(train);
    }
    let shares = equal_shares(powers.iter().map(|&power| i64::from(power)).sum(), powers.len());
    let mut train = train.clone();
    for ((core, share), power) in train.cores.iter_mut().zip(shares).zip(powers) {
        scale_by_power(&mut core.data, share - power);
    }
    Cow::Owned(train)
}
