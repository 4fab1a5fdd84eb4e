//! Colour bar and time over the picture.

use super::RenderSettings;
use super::color::{Rgb, viridis};
use super::font::width as text_width;
use super::image::{Align, Image};
use super::subject::Legend;
use crate::plot::Axis;

const INK: Rgb = [0.13, 0.13, 0.13];

/// Pixels that the picture leaves free at the left, top, right and bottom.
pub fn margins(settings: &RenderSettings) -> [f64; 4] {
    let unit = unit(settings.width, settings.height);
    [2.0 * unit, 4.0 * unit, 11.0 * unit, 4.5 * unit]
}

/// One percent of the picture's size.
fn unit(width: usize, height: usize) -> f64 {
    0.01 * (width.min(height * 4 / 3) as f64 * 0.75)
}

/// Draws the colour bar at the right and the time at the lower left.
pub fn draw(image: &mut Image, legend: Option<&Legend>, time: f64, grains: usize) {
    let unit = unit(image.width, image.height);
    let (width, height) = (image.width as f64, image.height as f64);
    let size = 1.7 * unit;
    let grains = if grains == 1 { "1 body".into() } else { format!("{grains} bodies") };
    let stamp = format!("t = {time:.3} s    {grains}");
    image.text(2.5 * unit, height - 2.0 * unit, &stamp, size, Align::Left, INK);
    let Some(legend) = legend else { return };
    let axis = Axis::linear("").between(legend.range[0], legend.range[1]);
    let ticks = axis.ticks(legend.range);
    // Long numbers push the bar to the left, so that none is cut at the picture's edge.
    let longest = ticks.iter().map(|tick| size * text_width(&tick.text)).fold(0.0, f64::max);
    let (bar_left, bar_width) = (width - 10.5 * unit - (longest - 6.4 * unit).max(0.0), 2.2 * unit);
    let (top, length) = (0.22 * height, 0.56 * height);
    for row in 0..length as usize {
        let fraction = 1.0 - (row as f64 + 0.5) / length;
        image.fill(bar_left, top + row as f64, bar_width, 1.0, viridis(fraction));
    }
    let [low, high] = legend.range;
    for tick in ticks {
        let y = top + length * (1.0 - (tick.value - low) / (high - low));
        let from = bar_left + bar_width;
        image.strokes(&[[[from, y], [from + 0.6 * unit, y]]], (0.12 * unit).max(1.0), INK);
        image.text(from + 1.1 * unit, y + 0.5 * size, &tick.text, size, Align::Left, INK);
    }
    let (right, bottom) = (bar_left + bar_width, top + length);
    let outline = [
        [[bar_left, top], [right, top]],
        [[right, top], [right, bottom]],
        [[right, bottom], [bar_left, bottom]],
        [[bar_left, bottom], [bar_left, top]],
    ];
    image.strokes(&outline, (0.12 * unit).max(1.0), INK);
    if legend.exceeded {
        image.text(width - 1.5 * unit, top - 2.3 * unit, "and more", 0.8 * size, Align::Right, INK);
    }
    // A long label takes two lines, so that it stays beside the picture.
    let words = legend.label.split(' ').count();
    let (first, second) = match legend.label.match_indices(' ').nth(words.saturating_sub(3)) {
        Some((at, _)) if words > 2 => (&legend.label[..at], &legend.label[at + 1..]),
        _ => ("", legend.label.as_str()),
    };
    image.text(width - 1.5 * unit, top - 7.8 * unit, first, size, Align::Right, INK);
    image.text(width - 1.5 * unit, top - 4.8 * unit, second, size, Align::Right, INK);
}
