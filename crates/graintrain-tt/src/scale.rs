//! Powers of two taken out of and put back into numbers: exact, so that sums of squares neither overflow nor vanish.

use crate::vector::Core;
use graintrain_linalg::dense::DenseError;

/// The largest absolute value.
///
/// # Errors
/// [`DenseError::NotFinite`] if a number is infinite or not a number.
pub(crate) fn largest_finite(data: &[f64]) -> Result<f64, DenseError> {
    if data.iter().all(|x| x.is_finite()) {
        Ok(data.iter().fold(0.0, |largest, x| x.abs().max(largest)))
    } else {
        Err(DenseError::NotFinite)
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

/// Scales the largest absolute value into [1, 2) and returns the exponent taken out; none (and nothing changed) if it
/// is zero or not finite.
pub(crate) fn factor_out(data: &mut [f64]) -> Option<i32> {
    let largest = largest_finite(data).ok().filter(|&largest| largest > 0.0)?;
    let power = binary_exponent(largest);
    scale_by_power(data, -power);
    Some(power)
}

/// Multiplies a train by 2^power: into the last core where its numbers stay normal, else the same share to every core.
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
    let (each, extra) = (power.div_euclid(d as i64), power.rem_euclid(d as i64));
    (0..d as i64).map(|k| (each + i64::from(k < extra)).clamp(-2044, 2044) as i32).collect()
}
