//! A scene's error with an excerpt of the text that it is about.

use crate::error::Failure;
use graintrain_io::scene::SceneError;
use std::ops::Range;

/// [`SceneError`] as miette shows it: message, excerpt, help.
#[derive(Debug)]
struct Excerpt {
    error: SceneError,
    /// The text with its long lines cut, and where in it the error is.
    text: Option<(miette::NamedSource<String>, Range<usize>)>,
    message: String,
}

/// Longest line that is shown as it is, bytes: meshes stand in lines of many thousands.
const LINE: usize = 240;

/// Of a longer one, so much is shown before and after the place.
const AROUND: usize = 60;

/// Bad input: a scene that cannot be used.
pub fn scene_failure(error: SceneError) -> Failure {
    let text = error.location.as_ref().map(|location| {
        // A table spans many lines: its first line is enough to find it.
        let spanned = location.source.text.get(location.span.clone()).unwrap_or("");
        let length = spanned.find('\n').unwrap_or(spanned.len());
        let place = location.span.start..location.span.start + length;
        let (text, place) = with_short_lines(&location.source.text, place);
        (miette::NamedSource::new(&location.source.name, text), place)
    });
    Failure::Input(miette::Report::new(Excerpt { message: error.kind.to_string(), text, error }))
}

/// The text with every long line cut down to its beginning, the one with the place to what is around it; and
/// the place therein.
fn with_short_lines(text: &str, place: Range<usize>) -> (String, Range<usize>) {
    let mut short = String::with_capacity(text.len().min(1 << 20));
    let mut found = 0..0;
    let mut start = 0;
    for line in text.split_inclusive('\n') {
        let end = start + line.len();
        let holds = (start..end).contains(&place.start) || place.start == end && end == text.len();
        let mut shown = start..end;
        if line.len() > LINE {
            let from = if holds { place.start.saturating_sub(AROUND).max(start) } else { start };
            let to = if holds { place.end.min(from + LINE) + AROUND } else { start + LINE };
            shown = text.floor_char_boundary(from)..text.floor_char_boundary(to.min(end));
        }
        short.push_str(if shown.start > start { "... " } else { "" });
        if holds {
            let begin = short.len() + place.start - shown.start;
            found = begin..begin + place.end.min(shown.end) - place.start;
        }
        short.push_str(&text[shown.clone()]);
        short.push_str(if shown.end < end { " ...\n" } else { "" });
        start = end;
    }
    (short, found)
}

impl std::fmt::Display for Excerpt {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.message)
    }
}

impl std::error::Error for Excerpt {}

impl miette::Diagnostic for Excerpt {
    fn help<'a>(&'a self) -> Option<Box<dyn std::fmt::Display + 'a>> {
        self.error.help().map(|help| Box::new(help) as Box<dyn std::fmt::Display>)
    }

    fn source_code(&self) -> Option<&dyn miette::SourceCode> {
        self.text.as_ref().map(|(text, _)| text as &dyn miette::SourceCode)
    }

    fn labels(&self) -> Option<Box<dyn Iterator<Item = miette::LabeledSpan> + '_>> {
        let (_, place) = self.text.as_ref()?;
        let label = miette::LabeledSpan::new(Some("here".into()), place.start, place.len());
        Some(Box::new(std::iter::once(label)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_lines_are_cut_around_the_place() {
        let long = format!(
            "a = 1\nb = [{}] here {}\n{}\nend",
            "1, ".repeat(5000),
            "2, ".repeat(5000),
            "x".repeat(400)
        );
        let at = long.find("here").unwrap();
        let (short, place) = with_short_lines(&long, at..at + 4);
        assert_eq!(&short[place], "here");
        assert_eq!(short.lines().count(), 4);
        assert!(short.lines().all(|line| line.len() < LINE + 10), "{short}");
        // Short texts, a place that runs over the end of what is shown, and one at the end of the text.
        assert_eq!(with_short_lines("a = 1\nb = 2", 6..7), ("a = 1\nb = 2".to_string(), 6..7));
        assert_eq!(with_short_lines("a", 1..1), ("a".to_string(), 1..1));
        let (short, place) = with_short_lines(&long, at..long.len());
        assert!(short[place].starts_with("here"));
        let accents = "é".repeat(1000);
        let (short, place) = with_short_lines(&accents, 1000..1002);
        assert_eq!(&short[place], "é");
    }
}
