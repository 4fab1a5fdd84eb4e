//! Several files in one input: a line `--- NAME` above each, with an end of line before it that belongs to no
//! file.

/// What begins the line above a file.
const MARK: &[u8] = b"--- ";

/// A file of an input.
#[derive(Clone, Debug, PartialEq)]
pub struct Part<'a> {
    /// What the line above it says.
    pub name: &'a str,
    /// Its bytes.
    pub content: &'a [u8],
}

/// The files of an input; what stands above the first line of this kind belongs to none.
pub fn parts(input: &[u8]) -> Vec<Part<'_>> {
    let starts: Vec<usize> = (0..input.len())
        .filter(|&at| (at == 0 || input[at - 1] == b'\n') && input[at..].starts_with(MARK))
        .collect();
    let ends = starts.iter().skip(1).map(|next| next - 1).chain([input.len()]);
    let part = |(start, end): (usize, usize)| {
        let lines = input.get(start + MARK.len()..end)?;
        let length = lines.iter().position(|&byte| byte == b'\n')?;
        let name = std::str::from_utf8(&lines[..length]).ok()?;
        Some(Part { name, content: &lines[length + 1..] })
    };
    starts.iter().copied().zip(ends).filter_map(part).collect()
}

/// The input of these files.
pub fn input<'a>(files: impl IntoIterator<Item = (&'a str, &'a [u8])>) -> Vec<u8> {
    let parts = files.into_iter().map(|(name, content)| [MARK, name.as_bytes(), b"\n", content].concat());
    parts.collect::<Vec<_>>().join(&b'\n')
}

/// Whether a file of this name can be nowhere but in the folder that it is written into.
pub fn is_plain(name: &str) -> bool {
    let is_sound = |byte: u8| byte.is_ascii_alphanumeric() || b"._-".contains(&byte);
    !name.is_empty() && name.len() < 100 && name.bytes().all(is_sound) && !name.starts_with('.')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_found_again() {
        let files = [("a.csv", &b"x,y\n"[..]), ("b|c", b"\xff--- \n"), ("d", b"")];
        let bytes = input(files);
        let found: Vec<(&str, &[u8])> = parts(&bytes).iter().map(|part| (part.name, part.content)).collect();
        assert_eq!(found, files);
        assert_eq!(parts(b"--- a"), []);
    }
}
