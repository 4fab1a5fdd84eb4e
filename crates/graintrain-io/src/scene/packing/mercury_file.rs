//! Spheres of MercuryDPM: `.data` files (a header line with the number of particles, time and box, then a
//! line per particle, frame after frame) and restart files (a line per particle with named values).
//!
//! Source: MercuryDPM's documentation of its output files; data files have 14 columns (x y z vx vy vz radius,
//! three angles, three angular velocities, a number) under 8 in the header.

use super::text::{count, ended_text, number, row, vector};
use super::{FileContent, FileProblem};

/// Reads a frame of a data file, counted from 0, the last one where it is `None`; or all particles of a
/// restart file.
pub(super) fn read(bytes: &[u8], frame: Option<u64>) -> Result<FileContent, FileProblem> {
    let text = ended_text(bytes)?;
    let is_restart = text.lines().any(|line| line.trim_start().starts_with("Particles "));
    if is_restart { restart(text) } else { data(text, frame) }
}

fn data(text: &str, frame: Option<u64>) -> Result<FileContent, FileProblem> {
    let mut lines = (1..).zip(text.lines()).filter(|(_, line)| !line.trim().is_empty());
    let mut found = None;
    let mut frames = 0_u64;
    while let Some((header, text)) = lines.next() {
        let particles = count(text.split_whitespace().next(), header)?;
        if text.split_whitespace().count() != 8 {
            let problem =
                "expected the eight values of a header: number of particles, time, least and largest x, y, z";
            return Err(FileProblem::at(header, problem));
        }
        let mut content = FileContent::default();
        let (mut radii, mut velocities) = (Vec::new(), Vec::new());
        for made in 0..particles {
            let Some((line, text)) = lines.next() else {
                return Err(FileProblem::at(
                    header,
                    format!("it ends after {made} of {particles} particles"),
                ));
            };
            let words = row(text, 7, line)?;
            content.position.push(vector(&words, [0, 1, 2], line)?);
            velocities.push(vector(&words, [3, 4, 5], line)?);
            radii.push(number(words[6], line)?);
        }
        (content.radius, content.velocity) = (Some(radii), Some(velocities));
        if frame.is_none_or(|frame| frame == frames) {
            found = Some(content);
        }
        frames += 1;
    }
    found.ok_or_else(|| FileProblem::no_frame(frame, frames, "it is empty"))
}

fn restart(text: &str) -> Result<FileContent, FileProblem> {
    let mut lines = (1..).zip(text.lines());
    let (mut content, mut radii, mut velocities) = (FileContent::default(), Vec::new(), Vec::new());
    while let Some((header, text)) = lines.next() {
        let Some(rest) = text.trim_start().strip_prefix("Particles ") else { continue };
        let particles = count(rest.split_whitespace().next(), header)?;
        for made in 0..particles {
            let Some((line, text)) = lines.next() else {
                return Err(FileProblem::at(
                    header,
                    format!("it ends after {made} of {particles} particles"),
                ));
            };
            let words: Vec<&str> = text.split_whitespace().collect();
            let after = |name: &str, values: usize| {
                let at = words.iter().position(|word| *word == name).map(|k| k + 1);
                at.filter(|at| at + values <= words.len())
                    .ok_or_else(|| FileProblem::at(line, format!("the particle has no `{name}`")))
            };
            let triple = |at: usize| [at, at + 1, at + 2];
            content.position.push(vector(&words, triple(after("position", 3)?), line)?);
            velocities.push(vector(&words, triple(after("velocity", 3)?), line)?);
            radii.push(number(words[after("radius", 1)?], line)?);
        }
    }
    (content.radius, content.velocity) = (Some(radii), Some(velocities));
    Ok(content)
}

#[cfg(test)]
mod tests {
    use super::*;
    use graintrain::math::Vec3;

    #[test]
    fn data_and_restart_files_say_the_same() {
        let data = "1 0 0 0 0 1 1 1\n9 9 9 0 0 0 1 0 0 0 0 0 0 0\n2 0.5 0 0 0 1 1 1\n0.1 0.2 0.3 1 2 3 0.05 0 0 0 0 0 0 0\n0.5 0.5 0.5 0 0 \
                    0 0.1 0 0 0 0 0 0 0\n";
        let restart = "restart_version 1.0\nSpecies 1\nParticles 2\nSphericalParticle id 0 indSpecies 0 position 0.1 0.2 0.3 orientation 1 \
                       0 0 0 velocity 1 2 3 angularVelocity 0 0 0 force 0 0 0 torque 0 0 0 radius 0.05 invMass 1\nSphericalParticle id \
                       1 indSpecies 0 position 0.5 0.5 0.5 orientation 1 0 0 0 velocity 0 0 0 angularVelocity 0 0 0 radius 0.1 \
                       invMass 1\nInteractions 0\n";
        let (a, b) = (read(data.as_bytes(), None).unwrap(), read(restart.as_bytes(), None).unwrap());
        assert_eq!(a, b);
        assert_eq!((a.position[0], a.radius.unwrap()), (Vec3::new(0.1, 0.2, 0.3), vec![0.05, 0.1]));
        assert_eq!(read(data.as_bytes(), Some(0)).unwrap().position.len(), 1);
        // Cut after a line the header promises too much; within one its last number may have lost digits.
        let whole_lines = data.match_indices('\n').nth(3).unwrap().0 + 1;
        assert_eq!(read(&data.as_bytes()[..whole_lines], None).unwrap_err().line, Some(3));
        assert_eq!(read(&data.as_bytes()[..90], None).unwrap_err().line, Some(4));
        assert_eq!(read(restart.replace("radius", "size").as_bytes(), None).unwrap_err().line, Some(4));
        assert_eq!(read(b"1 2 3\n", None).unwrap_err().line, Some(1));
    }
}
