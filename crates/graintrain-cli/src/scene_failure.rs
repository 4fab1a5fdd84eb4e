//! A scene's error with an excerpt of the text that it is about.

use crate::error::Failure;
use graintrain_io::scene::SceneError;

/// [`SceneError`] as miette shows it: message, excerpt, help.
#[derive(Debug)]
struct Excerpt {
    error: SceneError,
    text: Option<miette::NamedSource<String>>,
    message: String,
}

/// Bad input: a scene that cannot be used.
pub fn scene_failure(error: SceneError) -> Failure {
    let text = error
        .location
        .as_ref()
        .map(|location| miette::NamedSource::new(&location.source.name, location.source.text.clone()));
    Failure::Input(miette::Report::new(Excerpt { message: error.kind.to_string(), text, error }))
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
        self.text.as_ref().map(|text| text as &dyn miette::SourceCode)
    }

    fn labels(&self) -> Option<Box<dyn Iterator<Item = miette::LabeledSpan> + '_>> {
        let location = self.error.location.as_ref()?;
        // A table spans many lines: its first line is enough to find it.
        let text = location.source.text.get(location.span.clone()).unwrap_or("");
        let length = text.find('\n').unwrap_or(text.len());
        let label = miette::LabeledSpan::new(Some("here".into()), location.span.start, length);
        Some(Box::new(std::iter::once(label)))
    }
}
