//! What `render --film` does: pictures through ffmpeg, into an animated PNG, or into a folder.

use crate::error::Failure;
use crate::solving::spinner;
use crate::terminal::{say, tell};
use graintrain_io::files::{OutputError, make_folder, write_atomically};
use graintrain_view::film::{Film, FilmError, animated_png};
use graintrain_view::render::{Image, RenderSettings};
use graintrain_view::view::RunFolder;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitCode, Stdio};

/// Endings of films that ffmpeg writes.
const BY_FFMPEG: [&str; 5] = ["mp4", "webm", "mkv", "mov", "gif"];

/// The name of a film, for the command line.
pub fn film_path(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    if ending(&path) == "png" || BY_FFMPEG.contains(&ending(&path).as_str()) {
        return Ok(path);
    }
    Err(format!("let the name end in .png (animated) or one of .{}", BY_FFMPEG.join(", .")))
}

fn ending(path: &Path) -> String {
    path.extension().unwrap_or_default().to_string_lossy().to_lowercase()
}

/// Makes the film of a run.
pub fn film(folder: &Path, settings: &RenderSettings, speed: f64, out: &Path) -> Result<ExitCode, Failure> {
    let unreadable = |error| Failure::input_error(error, "give the folder of a run made by `graintrain run`");
    let run = RunFolder::open(folder).map_err(|error| unreadable(FilmError::View(error)))?;
    let film = Film::new(run, settings, speed).map_err(unreadable)?;
    let bar = spinner();
    let picture = |number: usize| {
        bar.set_message(format!("picture {} of {}", number + 1, film.pictures()));
        film.picture(number)
    };
    let written = match ending(out).as_str() {
        "png" => animated(&film, out, picture),
        _ => by_ffmpeg(&film, out, picture),
    };
    bar.finish_and_clear();
    let written = written?;
    say!(
        "{}: {}, {:.3} per second, {:.3} s simulated per second\n",
        written.display(),
        crate::closing::counted(film.pictures() as u64, "picture", "pictures"),
        film.rate,
        film.speed
    );
    // Of frames that are far apart none is shown for longer than a film can.
    if film.speed > speed * (1.0 + 1e-9) {
        tell!(
            "note: the film is not {speed} times as fast as the run but {:.3e} times, one picture per second; a slower one needs more frames \
             (`output.every`)",
            film.speed
        );
    }
    Ok(ExitCode::SUCCESS)
}

fn unmade(error: FilmError) -> Failure {
    match error {
        // The options of the picture are wrong; the error says how.
        FilmError::Render(error) => Failure::input_error(error, ""),
        error => Failure::work_error(error, ""),
    }
}

fn unwritten(error: OutputError) -> Failure {
    let remedy = error.remedy();
    Failure::work_error(error, remedy)
}

fn animated(
    film: &Film,
    out: &Path,
    picture: impl Fn(usize) -> Result<Image, FilmError>,
) -> Result<PathBuf, Failure> {
    let mut bytes = Vec::new();
    animated_png(&mut bytes, film.rate, film.pictures(), picture).map_err(unmade)?;
    write_atomically(out, &bytes).map_err(unwritten)?;
    Ok(out.to_path_buf())
}

/// Sends the pictures to ffmpeg; where it is not there, into a folder beside the film, with the command that
/// joins them.
fn by_ffmpeg(
    film: &Film,
    out: &Path,
    picture: impl Fn(usize) -> Result<Image, FilmError>,
) -> Result<PathBuf, Failure> {
    let first = picture(0).map_err(unmade)?;
    let program = std::env::var_os("FFMPEG").unwrap_or_else(|| "ffmpeg".into());
    let mut command = Command::new(&program);
    command.args(["-y", "-loglevel", "error", "-f", "rawvideo", "-pixel_format", "rgb24", "-video_size"]);
    command.arg(format!("{}x{}", first.width, first.height));
    command.args(["-framerate", &format!("{:.6}", film.rate), "-i", "-"]);
    if ending(out) != "gif" {
        // Most players know no other, and it needs even numbers of pixels.
        command.args(["-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2:0:0:white", "-pix_fmt", "yuv420p"]);
    }
    let child = command.arg(out).stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::piped()).spawn();
    match child {
        Ok(child) => feed(child, film, &first, picture).map(|()| out.to_path_buf()),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => into_folder(film, out, picture),
        Err(error) => {
            let what = std::io::Error::new(error.kind(), format!("{}: {error}", program.display()));
            Err(Failure::work_error(what, "let the variable FFMPEG name a program that can be started"))
        }
    }
}

fn feed(
    mut child: Child,
    film: &Film,
    first: &Image,
    picture: impl Fn(usize) -> Result<Image, FilmError>,
) -> Result<(), Failure> {
    let mut pipe = child.stdin.take();
    let mut send = |image: &Image| pipe.as_mut().is_some_and(|pipe| pipe.write_all(&image.bytes()).is_ok());
    // A pipe that breaks says nothing; what ffmpeg says at its end does.
    let mut listens = send(first);
    for number in 1..film.pictures() {
        if !listens {
            break;
        }
        listens = send(&picture(number).map_err(unmade)?);
    }
    drop(pipe);
    let ended = child.wait_with_output().map_err(|error| Failure::work_error(error, ""))?;
    if listens && ended.status.success() {
        return Ok(());
    }
    let said = String::from_utf8_lossy(&ended.stderr);
    let said = said.trim().lines().next().unwrap_or("it ended early").to_string();
    let what = std::io::Error::other(format!("ffmpeg made no film: {said}"));
    Err(Failure::work_error(
        what,
        "check the name and folder of the film, or choose .png (animated), which needs no ffmpeg",
    ))
}

fn into_folder(
    film: &Film,
    out: &Path,
    picture: impl Fn(usize) -> Result<Image, FilmError>,
) -> Result<PathBuf, Failure> {
    let folder = out.with_extension("pictures");
    make_folder(&folder).map_err(unwritten)?;
    for number in 0..film.pictures() {
        let mut bytes = Vec::new();
        let image = picture(number).map_err(unmade)?;
        image.write_png(&mut bytes).map_err(|error| unmade(error.into()))?;
        write_atomically(&folder.join(format!("{number:05}.png")), &bytes).map_err(unwritten)?;
    }
    tell!(
        "note: there is no ffmpeg: its pictures are in {0}. Elsewhere\n  ffmpeg -framerate {1:.6} -i {0}/%05d.png -pix_fmt yuv420p {2}\njoins them; \
         --film NAME.png makes an animated picture here",
        folder.display(),
        film.rate,
        out.display()
    );
    Ok(folder)
}
