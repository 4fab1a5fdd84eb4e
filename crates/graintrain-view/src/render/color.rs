//! Colour maps.

/// Red, green, blue in 0..=1, as displayed (sRGB).
pub type Rgb = [f64; 3];

/// The colour map viridis (S. van der Walt, N. Smith 2015, CC0), every sixteenth of its range.
const VIRIDIS: [[u8; 3]; 17] = [
    [68, 1, 84],
    [72, 24, 106],
    [71, 45, 123],
    [66, 64, 134],
    [59, 82, 139],
    [51, 99, 141],
    [44, 114, 142],
    [38, 130, 142],
    [33, 145, 140],
    [31, 160, 136],
    [40, 174, 128],
    [63, 188, 115],
    [94, 201, 98],
    [132, 212, 75],
    [173, 220, 48],
    [216, 226, 25],
    [253, 231, 37],
];

/// Colour of a fraction in [0, 1] (values outside are clamped, NaN is the low end): perceptually uniform,
/// monotone in lightness, legible with colour-blindness and in grey print.
pub fn viridis(fraction: f64) -> Rgb {
    let place = if fraction.is_nan() { 0.0 } else { fraction.clamp(0.0, 1.0) } * (VIRIDIS.len() - 1) as f64;
    let index = (place as usize).min(VIRIDIS.len() - 2);
    let weight = place - index as f64;
    let channel = |c: usize| {
        (f64::from(VIRIDIS[index][c]) * (1.0 - weight) + f64::from(VIRIDIS[index + 1][c]) * weight) / 255.0
    };
    [channel(0), channel(1), channel(2)]
}

/// A muted colour for a body's index: golden-ratio steps around the hue circle, so neighbours differ.
pub fn categorical(index: usize) -> Rgb {
    let hue = (index as f64 * 0.618_033_988_749_895).fract() * 6.0;
    let (saturation, value) = (0.5, 0.88);
    let channel = |shift: f64| {
        let k = (shift + hue) % 6.0;
        value - value * saturation * k.min(4.0 - k).clamp(0.0, 1.0)
    };
    [channel(5.0), channel(3.0), channel(1.0)]
}

/// a + weight (b - a).
pub fn mix(a: Rgb, b: Rgb, weight: f64) -> Rgb {
    [0, 1, 2].map(|c| a[c] + weight * (b[c] - a[c]))
}
