//! VTK's XML files of points (`.vtu`, `.vtp`): ascii, base64 and appended data, with or without zlib
//! compression.

use super::{FileContent, FileProblem};
use base64::Engine;
use base64::engine::DecodePaddingMode;
use base64::engine::general_purpose::{GeneralPurpose, GeneralPurposeConfig};
use graintrain::math::Vec3;
use roxmltree::{Document, Node};
use std::io::Read;

/// Decoder that does not mind missing padding.
const BASE64: GeneralPurpose = GeneralPurpose::new(
    &base64::alphabet::STANDARD,
    GeneralPurposeConfig::new().with_decode_padding_mode(DecodePaddingMode::Indifferent),
);

/// Data larger than this is taken to be a damaged header.
const MOST_BYTES: u64 = 1 << 34;

/// Reads points with the point arrays `radius` (or `diameter`) and `velocity` (or `v`).
pub(crate) fn read(bytes: &[u8]) -> Result<FileContent, FileProblem> {
    let (xml, appended) = split_appended(bytes)?;
    let document = Document::parse(&xml).map_err(|error| {
        FileProblem::at(error.pos().row as usize, format!("not a complete XML file: {error}"))
    })?;
    let root = document.root_element();
    if !root.has_tag_name("VTKFile") {
        return Err(FileProblem::at(1, "not a VTK file: its root is not <VTKFile>"));
    }
    let format = Format::new(root, appended)?;
    let mut content = FileContent::default();
    let mut pieces = 0;
    for piece in root.descendants().filter(|node| node.has_tag_name("Piece")) {
        pieces += 1;
        let line = |node: Node| document.text_pos_at(node.range().start).row as usize;
        let array = |node: Node| {
            format.values(node).map_err(|problem| {
                let name = node.attribute("Name").unwrap_or("Points");
                FileProblem::at(line(node), format!("array `{name}`: {problem}"))
            })
        };
        let points = piece
            .children()
            .find(|node| node.has_tag_name("Points"))
            .and_then(|points| points.children().find(|node| node.has_tag_name("DataArray")))
            .ok_or_else(|| FileProblem::at(line(piece), "it has no <Points>"))?;
        let position = vectors(array(points)?).map_err(|problem| FileProblem::at(line(points), problem))?;
        let announced = piece.attribute("NumberOfPoints").and_then(|count| count.trim().parse().ok());
        if announced != Some(position.len()) {
            let problem = format!(
                "NumberOfPoints announces {}, but there are {} points",
                piece.attribute("NumberOfPoints").unwrap_or("nothing"),
                position.len()
            );
            return Err(FileProblem::at(line(piece), problem));
        }
        let named = |names: &[&str]| {
            let data = piece.children().find(|node| node.has_tag_name("PointData"))?;
            let has_name = |node: &Node| {
                node.attribute("Name").is_some_and(|name| names.contains(&name.to_lowercase().as_str()))
            };
            data.children().find(has_name)
        };
        let check = |node: Node, length: usize| match length == position.len() {
            true => Ok(()),
            false => {
                let name = node.attribute("Name").unwrap_or_default();
                let problem = format!("array `{name}` has {length} entries for {} points", position.len());
                Err(FileProblem::at(line(node), problem))
            }
        };
        let radius = match (named(&["radius", "radii"]), named(&["diameter"])) {
            (Some(node), _) => Some((node, array(node)?)),
            (None, Some(node)) => Some((node, array(node)?.iter().map(|diameter| 0.5 * diameter).collect())),
            (None, None) => None,
        };
        if let Some((node, radius)) = radius {
            check(node, radius.len())?;
            content.radius.get_or_insert_default().extend(radius);
        }
        if let Some(node) = named(&["velocity", "v"]) {
            let velocity = vectors(array(node)?).map_err(|problem| FileProblem::at(line(node), problem))?;
            check(node, velocity.len())?;
            content.velocity.get_or_insert_default().extend(velocity);
        }
        content.position.extend(position);
    }
    let complete = |length: Option<usize>| length.is_none_or(|length| length == content.position.len());
    if pieces == 0 {
        return Err(FileProblem::new("it has no <Piece>"));
    }
    if !complete(content.radius.as_ref().map(Vec::len)) || !complete(content.velocity.as_ref().map(Vec::len))
    {
        return Err(FileProblem::new("some of its pieces lack an array that others have"));
    }
    Ok(content)
}

fn vectors(values: Vec<f64>) -> Result<Vec<Vec3>, String> {
    let (triples, rest) = values.as_chunks::<3>();
    if rest.is_empty() {
        return Ok(triples.iter().map(|&triple| Vec3::from_array(triple)).collect());
    }
    Err(format!("{} numbers are not a whole number of vectors", values.len()))
}

/// Appended data: encoding, and the bytes after the underscore that marks their start.
struct Appended<'a> {
    is_raw: bool,
    bytes: &'a [u8],
}

/// Splits a file into its XML and its appended data, which need not be text.
fn split_appended(bytes: &[u8]) -> Result<(String, Option<Appended<'_>>), FileProblem> {
    let text = |bytes: &[u8]| {
        String::from_utf8(bytes.to_vec()).map_err(|_| FileProblem::new("it is not a VTK XML file"))
    };
    let find = |haystack: &[u8], needle: &[u8]| haystack.windows(needle.len()).position(|w| w == needle);
    let Some(start) = find(bytes, b"<AppendedData") else { return Ok((text(bytes)?, None)) };
    let rest = &bytes[start..];
    let opening = find(rest, b">").ok_or_else(|| FileProblem::new("it ends inside <AppendedData>"))?;
    let is_raw = find(&rest[..opening], b"\"raw\"").is_some();
    let data = rest[opening + 1..].iter().position(|&byte| byte == b'_');
    let data =
        data.ok_or_else(|| FileProblem::new("its <AppendedData> lacks the `_` that marks its start"))?;
    let bytes_after = &rest[opening + data + 2..];
    Ok((text(&bytes[..start])? + "</VTKFile>", Some(Appended { is_raw, bytes: bytes_after })))
}

/// How the arrays of a file are written.
struct Format<'a> {
    is_big_endian: bool,
    header_bytes: usize,
    is_compressed: bool,
    appended: Option<Appended<'a>>,
}

impl<'a> Format<'a> {
    fn new(root: Node, appended: Option<Appended<'a>>) -> Result<Self, FileProblem> {
        let is_compressed = match root.attribute("compressor") {
            None => false,
            Some("vtkZLibDataCompressor") => true,
            Some(other) => {
                let problem = format!("compressor {other} is not supported, only vtkZLibDataCompressor");
                return Err(FileProblem::new(problem));
            }
        };
        Ok(Self {
            is_big_endian: root.attribute("byte_order") == Some("BigEndian"),
            header_bytes: if root.attribute("header_type") == Some("UInt64") { 8 } else { 4 },
            is_compressed,
            appended,
        })
    }

    /// All numbers of a `<DataArray>`.
    fn values(&self, array: Node) -> Result<Vec<f64>, String> {
        let text = || array.text().unwrap_or("");
        let bytes = match array.attribute("format").unwrap_or("ascii") {
            "ascii" => {
                let number =
                    |word: &str| word.parse::<f64>().map_err(|_| format!("`{word:.40}` is not a number"));
                return text().split_ascii_whitespace().map(number).collect();
            }
            "binary" => {
                let clean: Vec<u8> = text().bytes().filter(|byte| !byte.is_ascii_whitespace()).collect();
                self.block(&Stream { is_raw: false, bytes: &clean })?
            }
            "appended" => {
                let appended = self.appended.as_ref().ok_or("the file has no appended data")?;
                let offset = array.attribute("offset").and_then(|offset| offset.trim().parse().ok());
                let bytes = offset.and_then(|offset: usize| appended.bytes.get(offset..));
                let bytes = bytes.ok_or("its offset lies beyond the appended data")?;
                self.block(&Stream { is_raw: appended.is_raw, bytes })?
            }
            other => return Err(format!("unknown format {other:.40}")),
        };
        let kind = array.attribute("type").unwrap_or("Float64");
        let size = match kind {
            "Int8" | "UInt8" => 1,
            "Int16" | "UInt16" => 2,
            "Int32" | "UInt32" | "Float32" => 4,
            "Int64" | "UInt64" | "Float64" => 8,
            other => return Err(format!("unknown type {other:.40}")),
        };
        if bytes.len() % size != 0 {
            return Err(format!("{} bytes are not a whole number of {kind}", bytes.len()));
        }
        Ok(bytes.chunks_exact(size).map(|chunk| self.number(chunk, kind)).collect())
    }

    /// The bytes of one number, extended to eight, least significant first.
    fn widened(&self, chunk: &[u8], filler: u8) -> [u8; 8] {
        let mut wide = [filler; 8];
        for (index, &byte) in chunk.iter().enumerate().take(8) {
            wide[if self.is_big_endian { chunk.len() - 1 - index } else { index }] = byte;
        }
        wide
    }

    fn number(&self, chunk: &[u8], kind: &str) -> f64 {
        let unsigned = u64::from_le_bytes(self.widened(chunk, 0));
        match kind {
            "Float64" => f64::from_bits(unsigned),
            "Float32" => f32::from_bits(unsigned as u32).into(),
            _ if kind.starts_with('U') => unsigned as f64,
            _ => {
                let unused = 64 - 8 * chunk.len() as u32;
                (((unsigned << unused) as i64) >> unused) as f64
            }
        }
    }

    /// Header words at the start of a block.
    fn header(&self, stream: &Stream, words: usize) -> Result<Vec<u64>, String> {
        let bytes = stream.decode(words * self.header_bytes)?;
        Ok(bytes
            .chunks_exact(self.header_bytes)
            .map(|chunk| u64::from_le_bytes(self.widened(chunk, 0)))
            .collect())
    }

    /// The data of one array. Uncompressed: [bytes] data, encoded together. Compressed:
    /// [blocks, block size, last block's size, compressed sizes...], then, encoded apart, the compressed
    /// blocks.
    fn block(&self, stream: &Stream) -> Result<Vec<u8>, String> {
        if !self.is_compressed {
            let length = sane(self.header(stream, 1)?[0])?;
            return Ok(stream.decode(self.header_bytes + length)?.split_off(self.header_bytes));
        }
        let blocks = sane(self.header(stream, 1)?[0])?;
        // Each block needs its size in the header, so the file's length bounds their number.
        if blocks > stream.bytes.len() {
            return Err("the header of its compressed blocks is damaged".into());
        }
        let header = self.header(stream, 3 + blocks)?;
        let sizes = &header[3..];
        let total = sizes.iter().try_fold(0_u64, |sum, &size| sum.checked_add(size)).unwrap_or(u64::MAX);
        let compressed = stream.after((3 + blocks) * self.header_bytes)?.decode(sane(total)?)?;
        let mut data = Vec::new();
        let mut start = 0;
        for &size in sizes {
            let end = start + size as usize;
            let largest = sane(header[1].max(header[2]))? as u64;
            flate2::read::ZlibDecoder::new(&compressed[start..end])
                .take(largest)
                .read_to_end(&mut data)
                .map_err(|error| format!("a compressed block is damaged: {error}"))?;
            start = end;
        }
        Ok(data)
    }
}

fn sane(length: u64) -> Result<usize, String> {
    if length <= MOST_BYTES { Ok(length as usize) } else { Err("its length is damaged".into()) }
}

/// Encoded bytes that are decoded from the start.
struct Stream<'a> {
    is_raw: bool,
    bytes: &'a [u8],
}

impl Stream<'_> {
    /// The first `length` bytes after decoding.
    fn decode(&self, length: usize) -> Result<Vec<u8>, String> {
        let encoded = if self.is_raw { length } else { length.div_ceil(3) * 4 };
        // Files end where padding is left out.
        let available = encoded.min(self.bytes.len());
        let bytes = &self.bytes[..available];
        let mut decoded = match self.is_raw {
            true => bytes.to_vec(),
            false => BASE64.decode(bytes).map_err(|error| format!("its base64 text is damaged: {error}"))?,
        };
        if decoded.len() < length {
            return Err(format!("it is cut short: {} of {length} bytes are there", decoded.len()));
        }
        decoded.truncate(length);
        Ok(decoded)
    }

    /// What follows a part of `length` decoded bytes that was encoded by itself.
    fn after(&self, length: usize) -> Result<Self, String> {
        let encoded = if self.is_raw { length } else { length.div_ceil(3) * 4 };
        let bytes = self.bytes.get(encoded..).ok_or("it is cut short after its header")?;
        Ok(Self { is_raw: self.is_raw, bytes })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    // Written by an independent program (Python's struct, base64 and zlib).
    const INLINE: &str = "<VTKFile type=\"PolyData\" header_type=\"UInt64\" byte_order=\"LittleEndian\"><PolyData><Piece NumberOfPoints=\"2\"><PointData><DataArray type=\"Float32\" Name=\"radius\" format=\"binary\">CAAAAAAAAAAAAAA/AACAPg==</DataArray></PointData><Points><DataArray type=\"Float64\" NumberOfComponents=\"3\" format=\"binary\">MAAAAAAAAAAAAAAAAADwPwAAAAAAAABAAAAAAAAACEAAAAAAAAAQwAAAAAAAABZAAAAAAAAAGEA=</DataArray></Points></Piece></PolyData></VTKFile>";
    const COMPRESSED: &str = "<VTKFile type=\"PolyData\" header_type=\"UInt64\" byte_order=\"LittleEndian\" compressor=\"vtkZLibDataCompressor\"><PolyData><Piece NumberOfPoints=\"2\"><PointData><DataArray type=\"Float32\" Name=\"radius\" format=\"binary\">AgAAAAAAAAAEAAAAAAAAAAQAAAAAAAAADAAAAAAAAAAMAAAAAAAAAA==eJxjYGCwBwAAQwBAeJxjYGiwAwABQgC/</DataArray></PointData><Points><DataArray type=\"Float64\" NumberOfComponents=\"3\" format=\"binary\">AgAAAAAAAAAYAAAAAAAAABgAAAAAAAAAFAAAAAAAAAAWAAAAAAAAAA==eJxjYACBD/YMEOAAoTgcABe3Abh4nGNgAAGBA2CKQcwBQks4AAARhAF/</DataArray></Points></Piece></PolyData></VTKFile>";
    const APPENDED_HEAD: &str = "<VTKFile type=\"PolyData\" header_type=\"UInt32\"><PolyData><Piece NumberOfPoints=\"2\"><PointData><DataArray type=\"Float32\" Name=\"radius\" format=\"appended\" offset=\"0\"/></PointData><Points><DataArray type=\"Float64\" NumberOfComponents=\"3\" format=\"appended\" offset=\"12\"/></Points></Piece></PolyData><AppendedData encoding=\"raw\">_";

    fn assert_read(bytes: &[u8]) {
        let content = read(bytes).unwrap();
        assert_eq!(content.position, [Vec3::new(1.0, 2.0, 3.0), Vec3::new(-4.0, 5.5, 6.0)]);
        assert_eq!(content.radius.unwrap(), [0.5, 0.25]);
    }

    #[test]
    fn base64_compressed_and_raw_appended_data_are_read() {
        assert_read(INLINE.as_bytes());
        assert_read(COMPRESSED.as_bytes());
        let mut bytes = APPENDED_HEAD.as_bytes().to_vec();
        bytes.extend(8_u32.to_le_bytes());
        bytes.extend([0.5_f32, 0.25].iter().flat_map(|x| x.to_le_bytes()));
        bytes.extend(48_u32.to_le_bytes());
        bytes.extend([1.0_f64, 2.0, 3.0, -4.0, 5.5, 6.0].iter().flat_map(|x| x.to_le_bytes()));
        bytes.extend(b"</AppendedData></VTKFile>");
        assert_read(&bytes);
    }

    #[test]
    fn files_cut_short_are_refused_at_every_byte() {
        for text in [INLINE, COMPRESSED] {
            for end in 0..text.len() {
                assert!(read(&text.as_bytes()[..end]).is_err(), "{end}");
            }
        }
    }
}
