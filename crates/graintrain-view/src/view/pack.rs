//! Frames as bytes.
//!
//! The layout, little-endian, frame after frame: positions of all bodies as three planes (all x, all y, all
//! z) of `u16` fractions of the box, minus those of the frame before modulo 2^16; quaternions x y z w of the
//! oriented bodies as `i16` / 32767; each field of all bodies, and where bodies grow their sizes, as `u16`
//! fractions of their maxima; then, for each of the frame's contacts, planes of body A (`u32`), body B
//! (`u32`), point (`u16` x 3, interleaved), normal force (`u16`).
//!
//! What does not change from frame to frame comes as a block of its own: a byte per body (1: a grain);
//! materials of all bodies (`u16`); the bodies that are balls (`u32`) and their radii (`f32`, m); the bodies
//! whose orientation is in the frames (`u32`); then group by group its bodies (`u32`) and its triangles
//! (`f32` x 9, m). Each block is gzip-compressed and written in base64.

use super::model::Model;
use base64::Engine;
use base64::engine::general_purpose::STANDARD as BASE64;
use flate2::Compression;
use flate2::write::GzEncoder;
use serde::Serialize;
use std::io::{self, Write};

/// A frame of a replay.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Frame {
    /// s.
    pub time: f64,
    /// Of all bodies, m.
    pub position: Vec<[f32; 3]>,
    /// x y z w of the oriented bodies.
    pub orientation: Vec<[f32; 4]>,
    /// Numbers of all bodies, not negative, by field.
    pub fields: Vec<Vec<f32>>,
    /// Sizes of all bodies relative to the first frame; empty where nobody ever changes.
    pub size: Vec<f32>,
    /// Loaded contacts: bodies A and B, point (m), normal force (N).
    pub contacts: Vec<(u32, u32, [f32; 3], f32)>,
}

/// Ranges that the packed fractions refer to.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Ranges {
    /// Smallest coordinates of bodies and contact points, m.
    pub low: [f32; 3],
    /// Largest coordinates.
    pub high: [f32; 3],
    /// Largest value of each field; 1 where all are zero.
    pub fields: Vec<f32>,
    /// Largest normal force at a contact, N; 1 where there is none.
    pub force: f32,
    /// Largest size relative to the first frame; 0 where nobody ever changes.
    pub size: f32,
}

impl Ranges {
    /// The ranges of some frames; nowhere empty.
    pub fn of(frames: &[Frame]) -> Self {
        let mut ranges = Self {
            low: [f32::INFINITY; 3],
            high: [f32::NEG_INFINITY; 3],
            fields: vec![0.0; frames.first().map_or(0, |frame| frame.fields.len())],
            force: 0.0,
            size: 0.0,
        };
        for frame in frames {
            let points = frame.position.iter().chain(frame.contacts.iter().map(|contact| &contact.2));
            for point in points {
                for k in 0..3 {
                    ranges.low[k] = ranges.low[k].min(point[k]);
                    ranges.high[k] = ranges.high[k].max(point[k]);
                }
            }
            for (largest, values) in ranges.fields.iter_mut().zip(&frame.fields) {
                *largest = values.iter().copied().fold(*largest, f32::max);
            }
            ranges.force = frame.contacts.iter().map(|contact| contact.3).fold(ranges.force, f32::max);
            ranges.size = frame.size.iter().copied().fold(ranges.size, f32::max);
        }
        for k in 0..3 {
            if ranges.low[k] >= ranges.high[k] {
                let middle = if ranges.low[k].is_finite() { ranges.low[k] } else { 0.0 };
                (ranges.low[k], ranges.high[k]) = (middle - 0.5, middle + 0.5);
            }
        }
        let positive = |value: f32| if value > 0.0 { value } else { 1.0 };
        ranges.force = positive(ranges.force);
        ranges.fields.iter_mut().for_each(|largest| *largest = positive(*largest));
        ranges
    }

    fn place(&self, axis: usize, value: f32) -> u16 {
        fraction((value - self.low[axis]) / (self.high[axis] - self.low[axis]))
    }
}

/// A number in [0, 1] as 16 bits.
fn fraction(value: f32) -> u16 {
    (value.clamp(0.0, 1.0) * 65535.0).round() as u16
}

/// Packs what does not change; see the module for the order.
///
/// # Errors
/// None in practice: writing to memory.
pub fn pack_model(model: &Model) -> io::Result<String> {
    let mut out = GzEncoder::new(Vec::new(), Compression::new(7));
    let grains: Vec<u8> = model.is_grain.iter().map(|&grain| u8::from(grain)).collect();
    out.write_all(&grains)?;
    words(&mut out, model.material.iter().copied())?;
    indices(&mut out, &model.balls.body)?;
    singles(&mut out, model.balls.radius.iter().map(|&radius| radius as f32))?;
    indices(&mut out, &model.oriented)?;
    for group in &model.groups {
        indices(&mut out, &group.bodies)?;
        singles(&mut out, group.triangles.iter().copied())?;
    }
    Ok(BASE64.encode(out.finish()?))
}

/// Packs frames that all have the same bodies into base64 text.
///
/// # Errors
/// None in practice: writing to memory.
pub fn pack(frames: &[Frame], ranges: &Ranges) -> io::Result<String> {
    let mut out = GzEncoder::new(Vec::new(), Compression::new(7));
    let mut previous: Vec<u16> = Vec::new();
    for frame in frames {
        let planes: Vec<u16> = (0..3)
            .flat_map(|axis| frame.position.iter().map(move |point| ranges.place(axis, point[axis])))
            .collect();
        previous.resize(planes.len(), 0);
        let change = planes.iter().zip(&previous).map(|(now, before)| now.wrapping_sub(*before));
        words(&mut out, change)?;
        previous = planes;
        let turns =
            frame.orientation.iter().flatten().map(|q| (q.clamp(-1.0, 1.0) * 32767.0).round() as i16 as u16);
        words(&mut out, turns)?;
        for (values, largest) in frame.fields.iter().zip(&ranges.fields) {
            words(&mut out, values.iter().map(|value| fraction(value / largest)))?;
        }
        words(&mut out, frame.size.iter().map(|size| fraction(size / ranges.size)))?;
        for body in frame.contacts.iter().map(|contact| contact.0).chain(frame.contacts.iter().map(|c| c.1)) {
            out.write_all(&body.to_le_bytes())?;
        }
        let spots =
            frame.contacts.iter().flat_map(|contact| [0, 1, 2].map(|k| ranges.place(k, contact.2[k])));
        words(&mut out, spots)?;
        words(&mut out, frame.contacts.iter().map(|contact| fraction(contact.3 / ranges.force)))?;
    }
    Ok(BASE64.encode(out.finish()?))
}

fn words(out: &mut impl Write, values: impl Iterator<Item = u16>) -> io::Result<()> {
    let bytes: Vec<u8> = values.flat_map(u16::to_le_bytes).collect();
    out.write_all(&bytes)
}

fn indices(out: &mut impl Write, bodies: &[usize]) -> io::Result<()> {
    let bytes: Vec<u8> = bodies.iter().flat_map(|&body| (body as u32).to_le_bytes()).collect();
    out.write_all(&bytes)
}

fn singles(out: &mut impl Write, values: impl Iterator<Item = f32>) -> io::Result<()> {
    let bytes: Vec<u8> = values.flat_map(f32::to_le_bytes).collect();
    out.write_all(&bytes)
}
