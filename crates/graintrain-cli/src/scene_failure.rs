//! Scene errors as the terminal shows them: the line of the scene file with the place underlined.

use crate::error::Failure;
use graintrain::scene::SceneError;
use miette::{LabeledSpan, NamedSource, SourceCode, SourceSpan};

/// A scene error with its source text.
#[derive(Debug)]
struct SceneDiagnostic {
    error: SceneError,
    source: Option<NamedSource<String>>,
}

impl std::fmt::Display for SceneDiagnostic {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.error.fmt(f)
    }
}

impl std::error::Error for SceneDiagnostic {}

impl miette::Diagnostic for SceneDiagnostic {
    fn help<'a>(&'a self) -> Option<Box<dyn std::fmt::Display + 'a>> {
        self.error.help().map(|help| Box::new(help) as Box<dyn std::fmt::Display>)
    }

    fn source_code(&self) -> Option<&dyn SourceCode> {
        self.source.as_ref().map(|source| source as &dyn SourceCode)
    }

    fn labels(&self) -> Option<Box<dyn Iterator<Item = LabeledSpan> + '_>> {
        let location = self.error.location.as_ref()?;
        let span = SourceSpan::from(location.span.clone());
        Some(Box::new(std::iter::once(LabeledSpan::new_with_span(Some("here".to_string()), span))))
    }
}

/// Bad input: the scene cannot be used.
pub fn scene_failure(error: SceneError) -> Failure {
    let source = error
        .location
        .as_ref()
        .map(|location| NamedSource::new(&location.source.name, location.source.text.clone()));
    Failure::input(SceneDiagnostic { error, source })
}
