//! A picture in memory, and what is drawn on it in two dimensions.

use super::color::{Rgb, mix};
use super::font;
use std::io::Write;

/// Width x height pixels, rows from the top.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Colours, `width * height`.
    pub pixels: Vec<Rgb>,
}

/// Where the anchor of a text lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Align {
    /// At its left end.
    Left,
    /// In its middle.
    Center,
    /// At its right end.
    Right,
}

impl Image {
    /// A picture of one colour.
    pub fn new(width: usize, height: usize, color: Rgb) -> Self {
        Self { width, height, pixels: vec![color; width * height] }
    }

    /// Fills the pixels whose centres lie in a rectangle.
    pub fn fill(&mut self, left: f64, top: f64, width: f64, height: f64, color: Rgb) {
        let range = |from: f64, length: f64, limit: usize| {
            let first = (from.round().max(0.0) as usize).min(limit);
            first..((from + length).round().max(0.0) as usize).clamp(first, limit)
        };
        for y in range(top, height, self.height) {
            for x in range(left, width, self.width) {
                self.pixels[y * self.width + x] = color;
            }
        }
    }

    /// Draws strokes (straight segments with round ends) of one width without counting overlaps twice.
    pub fn strokes(&mut self, segments: &[[[f64; 2]; 2]], width: f64, color: Rgb) {
        let reach = 0.5 * width + 1.0;
        let ends = || segments.iter().flatten();
        let low = ends().fold([f64::INFINITY; 2], |m, p| [m[0].min(p[0]), m[1].min(p[1])]);
        let high = ends().fold([f64::NEG_INFINITY; 2], |m, p| [m[0].max(p[0]), m[1].max(p[1])]);
        let span = |axis: usize, limit: usize| {
            let first = (low[axis] - reach).floor().clamp(0.0, limit as f64) as usize;
            first..((high[axis] + reach).ceil().clamp(first as f64, limit as f64) as usize)
        };
        for y in span(1, self.height) {
            for x in span(0, self.width) {
                let at = [x as f64 + 0.5, y as f64 + 0.5];
                let distance =
                    segments.iter().map(|s| distance_to_segment(at, s)).fold(f64::INFINITY, f64::min);
                let coverage = (0.5 * width + 0.5 - distance).clamp(0.0, 1.0);
                let pixel = &mut self.pixels[y * self.width + x];
                *pixel = mix(*pixel, color, coverage);
            }
        }
    }

    /// Writes a line of text whose capitals are `size` pixels high, its baseline at height `y`.
    pub fn text(&mut self, x: f64, y: f64, text: &str, size: f64, align: Align, color: Rgb) {
        let width = font::width(text) * size;
        let mut left = match align {
            Align::Left => x,
            Align::Center => x - 0.5 * width,
            Align::Right => x - width,
        };
        for c in text.chars() {
            let place = |p: [f64; 2]| [left + p[0] * size, y - p[1] * size];
            let segments: Vec<[[f64; 2]; 2]> = font::strokes(c).into_iter().map(|s| s.map(place)).collect();
            if !segments.is_empty() {
                self.strokes(&segments, (0.13 * size).max(1.2), color);
            }
            left += font::advance(c) * size;
        }
    }

    /// The pixel at (x, y) with 8 bits per channel.
    pub fn bytes_at(&self, x: usize, y: usize) -> [u8; 3] {
        self.pixels[y * self.width + x].map(|channel| (channel.clamp(0.0, 1.0) * 255.0).round() as u8)
    }

    /// Rows from the top, three bytes per pixel.
    pub fn bytes(&self) -> Vec<u8> {
        (0..self.height).flat_map(|y| (0..self.width).flat_map(move |x| self.bytes_at(x, y))).collect()
    }

    /// Writes the picture as PNG, 8 bits per channel, sRGB.
    ///
    /// # Errors
    /// Those of the writer.
    pub fn write_png(&self, out: impl Write) -> Result<(), png::EncodingError> {
        let mut encoder = png::Encoder::new(out, self.width as u32, self.height as u32);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
        let mut writer = encoder.write_header()?;
        writer.write_image_data(&self.bytes())?;
        writer.finish()
    }
}

fn distance_to_segment(p: [f64; 2], [a, b]: &[[f64; 2]; 2]) -> f64 {
    let (along, to) = ([b[0] - a[0], b[1] - a[1]], [p[0] - a[0], p[1] - a[1]]);
    let length_squared = along[0] * along[0] + along[1] * along[1];
    let t = if length_squared > 0.0 {
        ((to[0] * along[0] + to[1] * along[1]) / length_squared).clamp(0.0, 1.0)
    } else {
        0.0
    };
    (to[0] - t * along[0]).hypot(to[1] - t * along[1])
}
