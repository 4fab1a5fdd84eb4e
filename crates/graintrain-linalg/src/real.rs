//! Functions of real numbers whose bits are the same on every machine.
//!
//! The methods of `f64` (`sin`, `exp`, `powf`, `hypot`, ...) call the C library's, whose last digit depends
//! on its version and on whether the processor has a fused multiply-add. Everything that a time step or a
//! scene depends on takes these instead: plain Rust, the same operations everywhere. Methods that are exact
//! or repeat exact operations (`sqrt`, `mul_add`, `floor`, `%`, `powi`, `to_radians`) stay methods.

pub use libm::{
    acos, asin, atan, atan2, cbrt, cos, exp, expm1 as exp_m1, log as ln, log1p as ln_1p, pow as powf, sin,
    sincos as sin_cos, tan,
};

/// sqrt(x^2 + y^2), without overflow or underflow. Next to where its squares are floats it is one root, far
/// cheaper than the C library's.
#[inline]
pub fn hypot(x: f64, y: f64) -> f64 {
    let square = x * x + y * y;
    if (1e-290..1e290).contains(&square) { square.sqrt() } else { libm::hypot(x, y) }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The values are those of the first machine that ran this; they depend on no C library and no processor.
    #[test]
    fn bits_are_the_same_everywhere() {
        let functions: [fn(f64) -> f64; 12] =
            [acos, asin, atan, cbrt, cos, exp, exp_m1, ln, ln_1p, sin, tan, |x| hypot(x, powf(x, 0.7))];
        let mut hash = 0xcbf2_9ce4_8422_2325_u64;
        for k in 1..1000 {
            let x = f64::from(k) / 1000.0;
            for bits in functions.iter().map(|f| f(x)).chain([atan2(x, 0.3)]).map(f64::to_bits) {
                hash = (hash ^ bits).wrapping_mul(0x0000_0100_0000_01b3);
            }
        }
        assert_eq!(format!("{hash:016x}"), "3c7853123709f8d2");
    }

    #[test]
    fn hypot_neither_overflows_nor_underflows() {
        for scale in [1e-300, 1e-160, 1e-20, 1.0, 1e20, 1e160, 1e300] {
            assert!((hypot(3.0 * scale, -4.0 * scale) / scale - 5.0).abs() < 1e-14, "{scale}");
        }
        assert_eq!([hypot(0.0, 0.0), hypot(f64::NEG_INFINITY, f64::NAN)], [0.0, f64::INFINITY]);
        assert!(hypot(f64::NAN, 1.0).is_nan());
    }
}
