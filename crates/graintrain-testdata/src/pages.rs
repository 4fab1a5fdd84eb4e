//! Pages of the repository against what the code has.

/// A count as pages write it: 30 000.
pub fn count(n: usize) -> String {
    let digits = n.to_string();
    let groups: Vec<&str> =
        digits.as_bytes().rchunks(3).rev().map(|g| std::str::from_utf8(g).unwrap()).collect();
    if digits.len() > 3 { groups.join(" ") } else { digits }
}

/// A page of the repository with its lines joined; `None` in the packed crate, which comes without.
fn page(name: &str) -> Option<String> {
    let path = format!("{}/../../docs/{name}", env!("CARGO_MANIFEST_DIR"));
    let text = std::fs::read_to_string(path).ok()?;
    Some(text.split_whitespace().collect::<Vec<_>>().join(" "))
}

/// Holds a page of the repository against sentences, its line breaks aside. Skipped in the packed crate.
///
/// # Panics
/// Where one is not there.
pub fn check(name: &str, sentences: &[String]) {
    let Some(page) = page(name) else { return eprintln!("skipped: no docs/{name}") };
    for sentence in sentences {
        assert!(page.contains(sentence), "docs/{name} lacks \"{sentence}\"");
    }
}
