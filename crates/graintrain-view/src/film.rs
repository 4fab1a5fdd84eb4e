//! Films: the frames of a run as pictures from one camera, with one range of colours.
//!
//! Each picture is a frame that the run wrote; none is invented between them. [`animated_png`] joins pictures
//! without any other program.

use crate::render::camera::Bounds;
use crate::render::image::Image;
use crate::render::subject::{bounds, grains, shown_values};
use crate::render::{ColorBy, RenderError, RenderSettings, render};
use crate::view::model::Model;
use crate::view::{RunFolder, ViewError};
use std::io::Write;

/// Most pictures per second: what screens show.
const FASTEST: f64 = 60.0;
/// Fewest pictures per second, and their number where all frames are of one moment.
const SLOWEST: f64 = 1.0;
/// Share of all values, over all pictures, that colours tell apart: the fastest moment is not to darken the
/// others.
const COLORED: f64 = 0.95;

/// Why there is no film, or not all of it.
#[derive(Debug, thiserror::Error)]
pub enum FilmError {
    /// The run cannot be read.
    #[error(transparent)]
    View(#[from] ViewError),
    /// The pictures cannot be made so.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// A speed that is no positive number.
    #[error("a film cannot be {0} times as fast as the run: give a positive number")]
    Speed(f64),
    /// They cannot be written.
    #[error(transparent)]
    Write(#[from] png::EncodingError),
}

/// The pictures of a film.
pub struct Film {
    run: RunFolder,
    shown: Vec<usize>,
    settings: RenderSettings,
    /// Pictures per second.
    pub rate: f64,
    /// Simulated seconds per second of the film.
    pub speed: f64,
}

impl Film {
    /// A film of a run's folder that plays `speed` times as fast as things went; frames that would come
    /// faster than a screen shows them are thinned evenly. The camera sees the grains and tools of all
    /// pictures, and colours have one range, unless `settings` say otherwise.
    ///
    /// Cost: every frame that is shown is read once here and once for its picture.
    ///
    /// # Errors
    /// [`FilmError`] for a run without frames, with damaged ones, or settings out of range.
    pub fn new(run: RunFolder, settings: &RenderSettings, speed: f64) -> Result<Self, FilmError> {
        if !(speed > 0.0 && speed.is_finite()) {
            return Err(FilmError::Speed(speed));
        }
        let times = run.times();
        let (Some(first), Some(last)) = (times.first(), times.last()) else {
            return Err(ViewError::NoFrames { folder: run.path().to_path_buf() }.into());
        };
        let per_second =
            |frames: usize| if last > first { (frames - 1) as f64 / (last - first) } else { 0.0 };
        let stride = (per_second(times.len()) * speed / FASTEST).ceil().max(1.0) as usize;
        let mut shown: Vec<usize> = (0..times.len()).rev().step_by(stride).collect();
        shown.reverse();
        let span = last - times[shown[0]];
        let natural = if span > 0.0 { (shown.len() - 1) as f64 / span } else { SLOWEST / speed };
        let rate = (natural * speed).max(SLOWEST);
        let settings = RenderSettings { step: run.step, ..settings.clone() };
        let mut film = Self { run, shown, settings, rate, speed: rate / natural };
        film.look_at_all()?;
        Ok(film)
    }

    /// Number of pictures, one at least.
    pub fn pictures(&self) -> usize {
        self.shown.len()
    }

    /// Chooses camera and colours by all pictures.
    fn look_at_all(&mut self) -> Result<(), FilmError> {
        let (first, _) = self.run.world_of_all(self.shown[0])?;
        let model = Model::new(&first);
        let (mut frames, mut absent, mut values) = (Vec::new(), Vec::new(), Vec::new());
        for &index in &self.shown {
            let (world, present) = self.run.world_of_all(index)?;
            let frame = model.frame(&world, self.settings.step, false);
            frames.push(crate::view::pack::Frame { position: frame.position, ..Default::default() });
            absent.push(crate::view::page::absent(&present));
            values.extend(shown_values(&self.run.world(index)?, &self.settings));
        }
        if self.settings.range.is_none() {
            self.settings.range = pooled_range(values, self.settings.color == ColorBy::Radius);
        }
        if self.settings.bounds.is_none() {
            let floor = bounds(&first, &grains(&first));
            let seen = model.fitted(&frames, &absent);
            // Grains at the rim keep the floor under them.
            let margin = model.grain_radius;
            let around = Bounds { low: seen.low - margin, high: seen.high + margin };
            self.settings.bounds = Some(if around.is_empty() { floor } else { around });
        }
        Ok(())
    }

    /// One of the pictures.
    ///
    /// # Errors
    /// [`FilmError`] for a damaged frame or settings out of range.
    pub fn picture(&self, number: usize) -> Result<Image, FilmError> {
        let world = self.run.world(self.shown[number])?;
        Ok(render(&world, &self.settings)?)
    }
}

/// From zero, or the smallest value, to what most values do not exceed; `None` where there is nothing to tell
/// apart.
fn pooled_range(mut values: Vec<f64>, from_smallest: bool) -> Option<[f64; 2]> {
    values.retain(|value| value.is_finite());
    values.sort_unstable_by(f64::total_cmp);
    let (smallest, largest) = (*values.first()?, *values.last()?);
    let low = if from_smallest { smallest } else { 0.0 };
    let usual = if from_smallest { largest } else { values[((values.len() - 1) as f64 * COLORED) as usize] };
    let high = if usual > low { usual } else { largest };
    (high > low).then_some([low, high])
}

/// Joins pictures of one size as an animated PNG that repeats for ever, `rate` pictures per second.
///
/// # Errors
/// Those of the writer and of whoever makes the pictures.
pub fn animated_png(
    out: impl Write,
    rate: f64,
    count: usize,
    mut picture: impl FnMut(usize) -> Result<Image, FilmError>,
) -> Result<(), FilmError> {
    let first = picture(0)?;
    let mut encoder = png::Encoder::new(out, first.width as u32, first.height as u32);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
    encoder.set_animated(count as u32, 0)?;
    encoder.set_frame_delay((1e4 / rate).round().clamp(1.0, 65535.0) as u16, 10_000)?;
    let mut writer = encoder.write_header()?;
    writer.write_image_data(&first.bytes())?;
    for number in 1..count {
        writer.write_image_data(&picture(number)?.bytes())?;
    }
    Ok(writer.finish()?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_of_a_film_leave_out_its_fastest_twentieth() {
        let values: Vec<f64> = (0..=100).map(f64::from).collect();
        assert_eq!(pooled_range(values.clone(), false), Some([0.0, 95.0]));
        assert_eq!(pooled_range(values, true), Some([0.0, 100.0]));
        let mut rests = vec![0.0; 99];
        rests.push(3.0);
        assert_eq!(pooled_range(rests, false), Some([0.0, 3.0]));
        assert_eq!(pooled_range(vec![0.0, f64::NAN], false), None);
        assert_eq!(pooled_range(Vec::new(), false), None);
    }

    /// What was joined is read back by the decoder, picture after picture.
    #[test]
    fn animated_pictures_are_those_that_were_joined() {
        let image = |shade: usize| {
            let mut image = Image::new(5, 3, [shade as f64 / 4.0, 0.5, 1.0]);
            image.fill(shade as f64, 0.0, 1.0, 3.0, [0.0; 3]);
            image
        };
        let mut bytes = Vec::new();
        animated_png(&mut bytes, 25.0, 4, |k| Ok(image(k))).unwrap();
        let mut reader = png::Decoder::new(std::io::Cursor::new(&bytes)).read_info().unwrap();
        assert_eq!(reader.info().animation_control().unwrap().num_frames, 4);
        for k in 0..4 {
            let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
            reader.next_frame(&mut pixels).unwrap();
            assert_eq!(pixels, image(k).bytes(), "picture {k}");
            let control = reader.info().frame_control().unwrap();
            assert_eq!((control.delay_num, control.delay_den), (400, 10_000));
        }
    }
}
