//! VTK multi-block files (`.vtm`): one frame made of particles, contacts and meshes in files of their own.

use std::fmt::Write as _;

/// Files of a frame, relative to the folder of the `.vtm`. The names of the blocks are those by which OVITO
/// knows what they hold.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Blocks {
    /// Particles.
    pub particles: Option<String>,
    /// Contacts; none where there is no contact (OVITO 3.17 ends with a floating-point exception on an empty
    /// file).
    pub contacts: Option<String>,
    /// Meshes, each with a name.
    pub meshes: Vec<(&'static str, String)>,
}

impl Blocks {
    /// The text of the file.
    pub fn text(&self) -> String {
        let mut text = String::from(
            "<?xml version=\"1.0\"?>\n<VTKFile type=\"vtkMultiBlockDataSet\" version=\"1.0\" byte_order=\"LittleEndian\">\n<vtkMultiBlockDataSet>\n",
        );
        let named = [("Particles", &self.particles), ("Contacts", &self.contacts)];
        let files = named.into_iter().filter_map(|(name, file)| Some((name, file.as_ref()?)));
        let mut index = 0;
        for (name, file) in files {
            let _ = writeln!(text, r#"<DataSet index="{index}" name="{name}" file="{file}"/>"#);
            index += 1;
        }
        if !self.meshes.is_empty() {
            let _ = writeln!(text, r#"<Block index="{index}" name="Meshes">"#);
            for (index, (name, file)) in self.meshes.iter().enumerate() {
                let _ = writeln!(text, r#"<DataSet index="{index}" name="{name}" file="{file}"/>"#);
            }
            text.push_str("</Block>\n");
        }
        text.push_str("</vtkMultiBlockDataSet>\n</VTKFile>\n");
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_are_numbered_without_gaps() {
        let blocks = Blocks {
            particles: Some("b.vtp".into()),
            contacts: None,
            meshes: vec![("fixed", "f.vtp".into()), ("moving", "m.vtp".into())],
        };
        let text = blocks.text();
        let document = roxmltree::Document::parse(&text).unwrap();
        let of = |name: &str| {
            let node = document.descendants().find(|node| node.attribute("name") == Some(name)).unwrap();
            (node.attribute("index").unwrap().to_string(), node.attribute("file").map(str::to_string))
        };
        assert_eq!(of("Particles"), ("0".into(), Some("b.vtp".into())));
        assert_eq!(of("Meshes"), ("1".into(), None));
        assert_eq!(of("moving"), ("1".into(), Some("m.vtp".into())));
    }
}
