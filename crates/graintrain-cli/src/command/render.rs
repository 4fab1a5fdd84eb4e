//! `graintrain render`: a picture of a moment of a run, or a film of all.

use crate::error::Failure;
use crate::filming::{film, film_path};
use crate::solving::positive;
use crate::terminal::{say, tell};
use graintrain::world::World;
use graintrain_io::checkpoint;
use graintrain_io::files::write_atomically;
use graintrain_io::scene;
use graintrain_view::render::{ColorBy, RenderError, RenderSettings, render};
use graintrain_view::view::{RunFolder, ViewError};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Make a picture (PNG) or a film of a run, without a display
///
/// RUN is the folder of a run or one of its checkpoints. Walls between the camera and the grains become
/// glass.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  \
    graintrain render out/sedimentation                  writes out/sedimentation/picture.png\n  \
    graintrain render out/shear --time 1.5 --force-chains --view=-30,15 --out chains.png\n  \
    graintrain render out/hopper --film hopper.mp4 --speed 0.5\n  \
    graintrain render out/run/checkpoints/step_00000400.ckpt --color force --out forces.png")]
pub struct Arguments {
    /// Folder of a run, or a checkpoint
    run: PathBuf,
    /// Time of the frame, in seconds or with a unit: the nearest one is taken; by default the last
    #[arg(long, value_name = "SECONDS", value_parser = time, allow_hyphen_values = true)]
    time: Option<f64>,
    /// What colours stand for: speed, force, radius, id
    #[arg(long, default_value = "speed")]
    color: ColorBy,
    /// Values at the ends of the colour bar, e.g. 0,1.5
    #[arg(long, value_name = "LOW,HIGH", value_parser = pair, allow_hyphen_values = true)]
    range: Option<[f64; 2]>,
    /// Draw contact forces as tubes whose width is the normal force
    #[arg(long)]
    force_chains: bool,
    /// Where the camera stands: degrees around the vertical, degrees above the horizon
    #[arg(long, value_name = "AROUND,ABOVE", value_parser = pair, default_value = "-60,24", allow_hyphen_values = true)]
    view: [f64; 2],
    /// Width and height in pixels
    #[arg(long, value_name = "WIDTHxHEIGHT", value_parser = size, default_value = "1200x900")]
    size: [usize; 2],
    /// File to write [default: RUN/picture.png, or a checkpoint's name with .png]
    #[arg(long, value_name = "FILE.png", value_parser = png)]
    out: Option<PathBuf>,
    /// Make a film of all frames: .mp4, .webm, .mkv, .mov or .gif through ffmpeg, .png as an animated picture
    #[arg(long, value_name = "FILE", value_parser = film_path, conflicts_with_all = ["time", "out"])]
    film: Option<PathBuf>,
    /// Speed of the film over that of the scene
    #[arg(long, value_name = "X", default_value_t = 1.0, requires = "film", value_parser = positive, allow_negative_numbers = true)]
    speed: f64,
}

fn time(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(seconds) if seconds.is_finite() => Ok(seconds),
        _ => scene::seconds(text),
    }
}

fn png(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    let is_png = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("png"));
    if is_png { Ok(path) } else { Err("pictures are PNG: let the name end in .png".to_string()) }
}

fn pair(text: &str) -> Result<[f64; 2], String> {
    let parse = |part: &str| part.trim().parse::<f64>().map_err(|_| format!("'{part}' is not a number"));
    let (a, b) = text.split_once(',').ok_or("expected two numbers with a comma between")?;
    Ok([parse(a)?, parse(b)?])
}

fn size(text: &str) -> Result<[usize; 2], String> {
    let parse =
        |part: &str| part.trim().parse::<usize>().map_err(|_| format!("'{part}' is not a whole number"));
    let (a, b) = text.split_once('x').ok_or("expected two whole numbers with an x between, e.g. 1200x900")?;
    Ok([parse(a)?, parse(b)?])
}

fn settings(arguments: &Arguments, step: f64) -> RenderSettings {
    RenderSettings {
        width: arguments.size[0],
        height: arguments.size[1],
        color: arguments.color,
        range: arguments.range,
        force_chains: arguments.force_chains,
        view: arguments.view,
        step,
        bounds: None,
    }
}

/// Writes the picture, or the film.
pub fn execute(arguments: &Arguments) -> Result<ExitCode, Failure> {
    if let Some(out) = &arguments.film {
        return film(&arguments.run, &settings(arguments, 1.0), arguments.speed, out);
    }
    let (world, step, farthest) = moment(&arguments.run, arguments.time)
        .map_err(|error| Failure::input_error(error, "give the folder of a run or a checkpoint"))?;
    let settings = settings(arguments, step);
    let image = render(&world, &settings).map_err(|error: RenderError| Failure::input_error(error, ""))?;
    let mut bytes = Vec::new();
    image.write_png(&mut bytes).map_err(|error| Failure::work_error(error, ""))?;
    let out = match &arguments.out {
        Some(out) => out.clone(),
        None if arguments.run.is_file() => arguments.run.with_extension("png"),
        None => arguments.run.join("picture.png"),
    };
    write_atomically(&out, &bytes).map_err(|error| {
        let remedy = error.remedy();
        Failure::work_error(error, remedy)
    })?;
    say!("{}: t = {:.3} s\n", out.display(), world.time);
    // A frame is never further from its time than frames from each other, unless the time is outside of the
    // run.
    if let Some(wanted) = arguments.time.filter(|wanted| (wanted - world.time).abs() > farthest) {
        tell!("note: no frame is near {wanted} s; this is the nearest one");
    }
    Ok(ExitCode::SUCCESS)
}

/// The state of the frame nearest to a time (the last one by default), the time step, and the longest time
/// between frames.
fn moment(path: &Path, time: Option<f64>) -> Result<(World, f64, f64), ViewError> {
    if path.is_file() {
        let checkpoint = checkpoint::read(path)?;
        return Ok((checkpoint.world, checkpoint.settings.stepping.step, checkpoint.settings.stepping.step));
    }
    let run = RunFolder::open(path)?;
    let times = run.times();
    let wanted = time.unwrap_or(f64::INFINITY);
    let nearest = (0..times.len()).min_by(|&a, &b| {
        let distance = |k: usize| if wanted.is_finite() { (times[k] - wanted).abs() } else { -times[k] };
        distance(a).total_cmp(&distance(b))
    });
    let farthest = times.windows(2).map(|pair| pair[1] - pair[0]).fold(run.step, f64::max);
    match nearest {
        Some(index) => Ok((run.world(index)?, run.step, farthest)),
        None => Ok((run.last, run.step, farthest)),
    }
}
