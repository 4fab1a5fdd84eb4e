//! Checkpoints: everything needed to go on with a run, bit for bit.
//!
//! A checkpoint is a file of
//!
//! | bytes | content |
//! |---|---|
//! | 8 | `GRAINCKP` |
//! | 4 | format version, little endian |
//! | 4 | CRC-32 of the payload |
//! | 8 | length of the payload |
//! | 8 | length of the payload when expanded |
//! | rest | payload: run settings, totals, world and marks of the run's files in postcard form, packed in blocks by LZ4 |

use crate::files::{OutputError, is_file_name, make_folder, write_durably};
use crate::mark::Marks;
use crate::packed::{pack, unpack};
use crate::run::{RunSettings, RunTotals};
use flate2::Crc;
use graintrain::world::World;
use serde::Deserialize;
use std::io;
use std::path::{Path, PathBuf};

const MAGIC: &[u8; 8] = b"GRAINCKP";
/// Raised whenever the layout of what is stored changes.
const VERSION: u32 = 18;
const HEADER: usize = 32;
/// Bytes that a payload may expand to: so many, and so many per byte of its own. Worlds at rest shrink to a
/// twentieth.
const MOST_EXPANDED: (u64, u64) = (1 << 26, 64);
/// Checkpoints kept in a folder: the last one and, should it be damaged, the one before.
const KEPT: usize = 2;

/// The state of a run between two steps.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct Checkpoint {
    /// What was asked for.
    pub settings: RunSettings,
    /// Sums over the steps so far.
    pub totals: RunTotals,
    /// The state.
    pub world: World,
    /// What the run's tables and lists of frames held.
    pub marks: Marks,
}

/// A file that is not a usable checkpoint.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CheckpointError {
    /// The file cannot be read.
    #[error("cannot read the checkpoint {}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// The file is something else.
    #[error("{} is not a checkpoint of this program", path.display())]
    NotACheckpoint {
        /// The file.
        path: PathBuf,
    },
    /// Written by another version of the program.
    #[error("the checkpoint {} has format {found}, but this program reads format {VERSION}: use the program that wrote it", path.display())]
    Version {
        /// The file.
        path: PathBuf,
        /// Its format.
        found: u32,
    },
    /// Cut short.
    #[error("the checkpoint {} is cut short: {found} of {expected} bytes", path.display())]
    Truncated {
        /// The file.
        path: PathBuf,
        /// Bytes there.
        found: u64,
        /// Bytes that its header promises.
        expected: u64,
    },
    /// Altered.
    #[error("the checkpoint {} is damaged: {what}", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What does not fit.
        what: String,
    },
    /// Whole, but it holds what this build of the program does not know.
    #[error(
        "the checkpoint {} holds something that this build of the program does not know, such as a solver that it was built \
         without ({what}): use the program that wrote it",
        path.display()
    )]
    Foreign {
        /// The file.
        path: PathBuf,
        /// Where reading ended.
        what: String,
    },
    /// No checkpoint in the folder.
    #[error("{}", what_lacks(folder))]
    None {
        /// The folder.
        folder: PathBuf,
    },
}

/// Why there are no checkpoints in the folder: a name that is mistyped, or a folder that no run has made.
fn what_lacks(folder: &Path) -> String {
    match folder.parent().filter(|run| !run.as_os_str().is_empty()) {
        Some(run) if !run.exists() => format!("there is no file or folder `{}`", run.display()),
        _ => format!("there is no checkpoint in {}", folder.display()),
    }
}

/// Writes a checkpoint of a run without other files into the folder, named after the step, and removes all
/// but the last two. The file appears whole or not at all.
///
/// # Errors
/// Where the file cannot be written; older checkpoints then remain.
pub fn write(
    folder: &Path,
    settings: &RunSettings,
    totals: &RunTotals,
    world: &World,
) -> Result<PathBuf, OutputError> {
    write_marked(folder, settings, totals, world, &Marks::new())
}

/// As [`write`] for a run with files, which have to be on the disk by now.
pub(crate) fn write_marked(
    folder: &Path,
    settings: &RunSettings,
    totals: &RunTotals,
    world: &World,
    marks: &Marks,
) -> Result<PathBuf, OutputError> {
    make_folder(folder)?;
    let path = folder.join(format!("step_{:08}.ckpt", world.step));
    let bytes =
        encode(settings, totals, world, marks).map_err(|error| OutputError::new("write", &path, error))?;
    write_durably(&path, &bytes)?;
    for old in list(folder).into_iter().skip(KEPT) {
        // One checkpoint too many harms nobody.
        let _ = std::fs::remove_file(old);
    }
    Ok(path)
}

/// Reads a checkpoint.
///
/// # Errors
/// [`CheckpointError`] says what is wrong with the file.
pub fn read(path: &Path) -> Result<Checkpoint, CheckpointError> {
    let bytes =
        std::fs::read(path).map_err(|source| CheckpointError::Read { path: path.to_path_buf(), source })?;
    decode(&bytes, path)
}

/// Reads a checkpoint from the bytes of its file; `name` is what messages call them.
///
/// # Errors
/// As [`read`].
pub fn from_bytes(bytes: &[u8], name: &str) -> Result<Checkpoint, CheckpointError> {
    decode(bytes, Path::new(name))
}

/// Reads the latest usable checkpoint in the folder; damaged later ones are given back beside it.
///
/// # Errors
/// [`CheckpointError::None`] where there is no checkpoint at all; the defect of the latest where none is
/// usable.
pub fn latest(folder: &Path) -> Result<(Checkpoint, Vec<CheckpointError>), CheckpointError> {
    let mut defects = Vec::new();
    for path in list(folder) {
        match read(&path) {
            Ok(checkpoint) => return Ok((checkpoint, defects)),
            Err(defect) => defects.push(defect),
        }
    }
    Err(if defects.is_empty() {
        CheckpointError::None { folder: folder.to_path_buf() }
    } else {
        defects.swap_remove(0)
    })
}

/// Whether there is a checkpoint in the folder, usable or not.
pub fn is_in(folder: &Path) -> bool {
    !list(folder).is_empty()
}

/// Checkpoints in the folder, latest first.
fn list(folder: &Path) -> Vec<PathBuf> {
    let step = |path: &PathBuf| -> Option<u64> {
        path.file_name()?.to_str()?.strip_prefix("step_")?.strip_suffix(".ckpt")?.parse().ok()
    };
    let Ok(entries) = std::fs::read_dir(folder) else { return Vec::new() };
    let mut found: Vec<(u64, PathBuf)> = entries
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter_map(|path| Some((step(&path)?, path)))
        .collect();
    found.sort_unstable();
    found.into_iter().rev().map(|(_, path)| path).collect()
}

fn crc(bytes: &[u8]) -> u32 {
    let mut crc = Crc::new();
    crc.update(bytes);
    crc.sum()
}

/// A checkpoint of a run without files as the bytes of its file.
///
/// # Errors
/// Where they do not fit into memory.
pub fn to_bytes(settings: &RunSettings, totals: &RunTotals, world: &World) -> io::Result<Vec<u8>> {
    encode(settings, totals, world, &Marks::new())
}

fn encode(settings: &RunSettings, totals: &RunTotals, world: &World, marks: &Marks) -> io::Result<Vec<u8>> {
    // A tuple has the layout of the struct that is read back.
    let plain = postcard::to_stdvec(&(settings, totals, world, marks)).map_err(io::Error::other)?;
    Ok(with_payload(&plain))
}

/// The bytes of a file whose payload is to expand to `expanded` bytes.
fn file(plain: &[u8], expanded: u64) -> Vec<u8> {
    let payload = pack(plain);
    let mut bytes = Vec::with_capacity(HEADER + payload.len());
    bytes.extend(MAGIC);
    bytes.extend(VERSION.to_le_bytes());
    bytes.extend(crc(&payload).to_le_bytes());
    bytes.extend((payload.len() as u64).to_le_bytes());
    bytes.extend(expanded.to_le_bytes());
    bytes.extend(payload);
    bytes
}

/// The expanded payload of a file, for tests that alter it: its form is that of this version of the program.
///
/// # Errors
/// As [`read`], but for what stands in the payload.
pub fn payload(bytes: &[u8], name: &str) -> Result<Vec<u8>, CheckpointError> {
    expand(bytes, Path::new(name))
}

/// The bytes of a file with this payload, whatever that says: lengths and check sum fit.
pub fn with_payload(plain: &[u8]) -> Vec<u8> {
    file(plain, plain.len() as u64)
}

fn expand(bytes: &[u8], path: &Path) -> Result<Vec<u8>, CheckpointError> {
    let path = path.to_path_buf();
    if !bytes.starts_with(&MAGIC[..bytes.len().min(MAGIC.len())]) {
        return Err(CheckpointError::NotACheckpoint { path });
    }
    let Some((header, payload)) = bytes.split_at_checked(HEADER) else {
        return Err(CheckpointError::Truncated { path, found: bytes.len() as u64, expected: HEADER as u64 });
    };
    let word32 = |at: usize| u32::from_le_bytes(std::array::from_fn(|k| header[at + k]));
    let word64 = |at: usize| u64::from_le_bytes(std::array::from_fn(|k| header[at + k]));
    let (version, sum, length, expanded) = (word32(8), word32(12), word64(16), word64(24));
    if version != VERSION {
        return Err(CheckpointError::Version { path, found: version });
    }
    if payload.len() as u64 > length {
        return Err(CheckpointError::Damaged { path, what: "something follows its end".to_string() });
    }
    if (payload.len() as u64) < length {
        let (found, expected) = (bytes.len() as u64, length.saturating_add(HEADER as u64));
        return Err(CheckpointError::Truncated { path, found, expected });
    }
    if crc(payload) != sum {
        return Err(CheckpointError::Damaged { path, what: "its check sum differs".to_string() });
    }
    // A few megabytes of zeros expand to as many gigabytes: states do not.
    let most = MOST_EXPANDED.0 + MOST_EXPANDED.1 * payload.len() as u64;
    if expanded > most {
        let what = format!("it claims to expand from {} to {expanded} bytes", payload.len());
        return Err(CheckpointError::Damaged { path, what });
    }
    unpack(payload, expanded as usize).map_err(|what| CheckpointError::Damaged { path, what })
}

fn decode(bytes: &[u8], path: &Path) -> Result<Checkpoint, CheckpointError> {
    let plain = expand(bytes, path)?;
    let path = path.to_path_buf();
    // The check sum holds: these bytes are what some build of this format wrote.
    let checkpoint: Checkpoint = postcard::from_bytes(&plain)
        .map_err(|error| CheckpointError::Foreign { path: path.clone(), what: error.to_string() })?;
    match defect(&checkpoint) {
        None => Ok(checkpoint),
        Some(what) => Err(CheckpointError::Damaged { path, what }),
    }
}

/// What makes a checkpoint one that no run can go on from.
fn defect(checkpoint: &Checkpoint) -> Option<String> {
    let Checkpoint { settings, totals, world, .. } = checkpoint;
    if let Err(error) = world.validate() {
        return Some(error.to_string());
    }
    if let Some(what) = settings.open_boundaries.defect(world, &totals.open_boundaries) {
        return Some(what);
    }
    let given = totals.open_boundaries.numbers.given(world.bodies.len());
    let streams = settings.open_boundaries.streams.len();
    if let Some(measure) = settings.measures.iter().find(|measure| !is_file_name(&measure.name)) {
        return Some(format!("measure {:?} has a name that is none of a file", measure.name));
    }
    if let Some(measure) = settings.measures.iter().find(|measure| !measure.fits(given, streams)) {
        return Some(format!("measure {} fits no run of it", measure.name));
    }
    if totals.stages.len() > settings.stages.len() {
        return Some("more stages have begun than there are".to_string());
    }
    let grows =
        |stage: &&crate::stage::Stage| stage.growth.as_ref().is_some_and(|growth| !growth.fits(given));
    if let Some(stage) = settings.stages.iter().find(grows) {
        return Some(format!("growth in stage {} fits no run of it", stage.name));
    }
    // What is still to come has to make worlds, too, one stage after the other.
    let coming = settings.stages.get(totals.stages.len()..).unwrap_or_default();
    let mut then = world.clone();
    coming.iter().find_map(|stage| {
        let begun = stage.begin(&mut then, &totals.open_boundaries.numbers);
        begun.and_then(|()| then.validate()).err().map(|error| format!("stage {}: {error}", stage.name))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Scene;
    use graintrain::stepper::Stepper;

    fn saved() -> (RunSettings, World) {
        let text = "[time]\nstep = 0.01\nsteps = 9\n[body.floor]\nshape = { plane = {} }\n[packing.a]\nradius = 0.1\n\
                    lattice = { counts = [2, 2, 2], pitch = 0.2, origin = [0, 0, 0.1] }\n[load.wind]\nforce = [1, \"t*2 N/s\", 0]\n\
                    [measure.m]\nstress = true\nprofile = { from = 0, to = 1, bins = 3 }\n"
            .replace("stress = true\n", "");
        let scene = Scene::parse("a", "a.toml", &text, Path::new(""), &[]).unwrap();
        let simulation = scene.build().unwrap();
        let settings = RunSettings::new(&simulation, None);
        let mut world = simulation.world;
        let mut stepper = Stepper::new(settings.stepping.clone()).unwrap();
        (0..3).for_each(|_| {
            stepper.step(&mut world).unwrap();
        });
        (settings, world)
    }

    /// Altered payloads with the right check sum: refused, or a world that a step can be asked of; never a
    /// panic.
    #[test]
    fn altered_payloads_make_no_panic() {
        let (settings, world) = saved();
        let plain = postcard::to_stdvec(&(&settings, &RunTotals::default(), &world, &Marks::new())).unwrap();
        let whole = with_payload(&plain);
        assert!(decode(&whole, Path::new("a")).is_ok());
        assert_eq!(payload(&whole, "a").unwrap(), plain);
        let mut state = 9_u64;
        let mut draw = |below: usize| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) as usize % below
        };
        let mut accepted = 0;
        for _ in 0..5000 {
            let mut altered = plain.clone();
            for _ in 0..=draw(3) {
                let at = draw(altered.len());
                match draw(3) {
                    0 => altered[at] ^= 1 << draw(8),
                    1 => altered[at] = [0, 1, 0x7f, 0x80, 0xff][draw(5)],
                    _ => {
                        altered.remove(at);
                    }
                }
            }
            let Ok(checkpoint) = decode(&with_payload(&altered), Path::new("a")) else {
                continue;
            };
            accepted += 1;
            let Checkpoint { settings, totals, mut world, .. } = checkpoint;
            // What may be asked of it: nothing panics, whatever comes of it.
            world.state_hash();
            if world.bodies.len() < 10 {
                let (numbers, streams) =
                    (&totals.open_boundaries.numbers, settings.open_boundaries.streams.len());
                let given = numbers.given(world.bodies.len());
                settings.measures.iter().for_each(|measure| assert!(measure.fits(given, streams)));
                let next = settings.stages.get(totals.stages.len());
                next.iter().for_each(|stage| assert!(stage.begin(&mut world, numbers).is_ok()));
            }
        }
        assert!(accepted > 500, "{accepted}");
    }

    #[test]
    fn a_small_file_that_claims_to_be_huge_is_refused() {
        let bomb = file(&vec![0; 1 << 20], 1 << 33);
        let error = decode(&bomb, Path::new("a")).unwrap_err();
        assert!(error.to_string().contains("expand"), "{error}");
    }
}
