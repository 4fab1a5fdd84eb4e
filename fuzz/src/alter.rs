//! Inputs from seeds: bits, bytes, numbers, words and ranges are altered, removed, repeated and taken from
//! elsewhere. The same seeds and numbers give the same inputs.

use std::ops::Range;

/// Longest input, bytes.
const LONGEST: usize = 1 << 18;

/// Bytes that mean something to somebody.
const BYTES: &[u8] = b"\0\x01\x7f\x80\xff 0123456789-+.eE,;:#\"'[]{}()<>/=\n\t";

/// Numbers that are too large, too small, or none.
const NUMBERS: &[&str] = &[
    "0",
    "-0",
    "1",
    "-1",
    "2",
    "3",
    "0.5",
    "7",
    "100",
    "65536",
    "1000000",
    "67108864",
    "100000000",
    "4294967295",
    "4294967296",
    "2147483648",
    "99999999999",
    "9223372036854775807",
    "9223372036854775808",
    "18446744073709551615",
    "18446744073709551616",
    "1e-300",
    "5e-324",
    "1e-9",
    "1e9",
    "1e16",
    "1e155",
    "-1e155",
    "1e300",
    "1e308",
    "-1e308",
    "1e309",
    "nan",
    "inf",
    "-inf",
];

/// Numbers of the same kind in eight bytes.
const WIDE: &[u64] =
    &[0, 1, 0x7f, 0xff, 0xffff, 0xffff_ffff, 1 << 26, 1 << 32, 1 << 53, u64::MAX, i64::MAX as u64];
/// And as floating-point numbers.
const FLOATS: &[f64] = &[
    0.0,
    -0.0,
    1.0,
    -1.0,
    1e-300,
    1e-30,
    1e9,
    1e155,
    -1e155,
    1e300,
    f64::MAX,
    f64::MIN,
    f64::NAN,
    f64::INFINITY,
];

/// Random numbers of one input (splitmix64).
#[derive(Clone, Debug)]
pub struct Draw(u64);

impl Draw {
    /// The numbers of input `number` of a session.
    pub fn new(session: u64, number: u64) -> Self {
        let mut draw = Self(session ^ number.wrapping_mul(0x9e37_79b9_7f4a_7c15));
        draw.next();
        draw
    }

    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut mixed = self.0;
        mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        mixed ^ (mixed >> 31)
    }

    /// A number below `n`; 0 where `n` is 0.
    pub fn below(&mut self, n: usize) -> usize {
        self.next().checked_rem(n as u64).unwrap_or(0) as usize
    }

    /// A short length more often than a long one, at most `most`.
    fn length(&mut self, most: usize) -> usize {
        let bits = self.below(1 + most.checked_ilog2().unwrap_or(0) as usize);
        (1 + self.below(2 << bits)).min(most)
    }

    fn one_of<'a, T>(&mut self, items: &'a [T]) -> &'a T {
        &items[self.below(items.len())]
    }
}

/// An input made from one of the seeds, of which there is at least one; `words` are put into it besides.
pub fn altered(seeds: &[Vec<u8>], words: &[Vec<u8>], draw: &mut Draw) -> Vec<u8> {
    let mut bytes = draw.one_of(seeds).clone();
    // Most inputs are altered a little: a lot is refused at its first line.
    let most = *draw.one_of(&[1, 1, 2, 2, 4, 12]);
    let times = 1 + draw.below(most);
    for _ in 0..times {
        alter(&mut bytes, seeds, words, draw);
        bytes.truncate(LONGEST);
    }
    bytes
}

fn alter(bytes: &mut Vec<u8>, seeds: &[Vec<u8>], words: &[Vec<u8>], draw: &mut Draw) {
    let at = draw.below(bytes.len());
    let length = draw.length(bytes.len() - at);
    let range = at..at + length;
    match draw.below(if words.is_empty() { 13 } else { 16 }) {
        0 if length > 0 => bytes[at] ^= 1 << draw.below(8),
        1 if length > 0 => bytes[at] = *draw.one_of(BYTES),
        2 => bytes.truncate(at),
        3 => drop(bytes.drain(range)),
        4 => {
            let most = *draw.one_of(&[1, 3, 200]);
            let times = 1 + draw.below(most);
            let repeated = bytes[range.clone()].repeat(times.min(LONGEST / length.max(1)));
            bytes.splice(at..at, repeated);
        }
        5..8 => {
            // The next number, or whatever is here.
            let next = bytes[at..].iter().position(u8::is_ascii_digit).map_or(at, |k| at + k);
            let token = token(bytes, next);
            let number = draw.one_of(NUMBERS).as_bytes();
            match draw.below(4) {
                0 => replace_all(bytes, token, number),
                _ => drop(bytes.splice(token, number.iter().copied())),
            }
        }
        8 => {
            let (first, second) = (token(bytes, at), token(bytes, draw.below(bytes.len())));
            let taken = bytes[second].to_vec();
            bytes.splice(first, taken);
        }
        9 => {
            let other = draw.one_of(seeds);
            let taken = token(other, draw.below(other.len()));
            bytes.splice(token(bytes, at), other[taken].iter().copied());
        }
        10 => {
            let other = draw.one_of(seeds);
            let from = draw.below(other.len());
            let taken = from..from + draw.length(other.len() - from);
            let replaced = if draw.below(2) == 0 { at..at } else { range };
            bytes.splice(replaced, other[taken].iter().copied());
        }
        11 => {
            let width = *draw.one_of(&[1, 2, 4, 8]);
            let number = *draw.one_of(WIDE);
            overwrite(bytes, at, &number.to_le_bytes()[..width]);
        }
        12 => {
            let number = *draw.one_of(FLOATS);
            match draw.below(2) {
                0 => overwrite(bytes, at, &number.to_le_bytes()),
                _ => overwrite(bytes, at, &(number as f32).to_le_bytes()),
            }
        }
        13.. => {
            let word = draw.one_of(words);
            // On a line of its own, or in the place of a word.
            let line = bytes[at..].iter().position(|&byte| byte == b'\n').map(|k| at + k + 1);
            match (line, draw.below(3)) {
                (Some(line), 0 | 1) => drop(bytes.splice(line..line, [word, &b"\n"[..]].concat())),
                _ => drop(bytes.splice(token(bytes, at), word.iter().copied())),
            }
        }
        _ => {}
    }
}

fn overwrite(bytes: &mut [u8], at: usize, number: &[u8]) {
    bytes[at..].iter_mut().zip(number).for_each(|(byte, new)| *byte = *new);
}

/// Puts something in the place of a word, wherever it stands.
fn replace_all(bytes: &mut Vec<u8>, word: Range<usize>, by: &[u8]) {
    let word = &bytes[word];
    let pieces = bytes.chunk_by(|a, b| in_word(a) == in_word(b));
    *bytes = pieces.map(|piece| if piece == word { by } else { piece }).collect::<Vec<_>>().concat();
}

/// Whether a byte is part of words and numbers.
fn in_word(byte: &u8) -> bool {
    byte.is_ascii_alphanumeric() || b"._+-".contains(byte)
}

/// The word or number around a place.
fn token(bytes: &[u8], at: usize) -> Range<usize> {
    let at = at.min(bytes.len());
    let start = bytes[..at].iter().rposition(|byte| !in_word(byte)).map_or(0, |k| k + 1);
    let end = bytes[at..].iter().position(|byte| !in_word(byte)).map_or(bytes.len(), |k| at + k);
    start..end
}
