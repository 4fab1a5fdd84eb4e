//! A stroke font of our own, so that pictures carry text on machines without fonts.
//!
//! A glyph is a list of polylines separated by spaces; a point is two hexadecimal digits, x then y. The
//! baseline is y = 3, lower-case letters reach y = 9, capitals and digits y = c, descenders y = 0.

const CAPITAL: f64 = 9.0;
const BASELINE: f64 = 3.0;
const GAP: f64 = 2.2;
/// Size of an exponent relative to the text, and how far above the baseline it stands, in units of the
/// capitals' height.
const EXPONENT: [f64; 2] = [0.6, 0.55];

/// The character that an exponent is a small one of.
fn exponent_of(c: char) -> Option<char> {
    const SMALL: &str = "\u{2070}\u{b9}\u{b2}\u{b3}\u{2074}\u{2075}\u{2076}\u{2077}\u{2078}\u{2079}\u{207b}";
    let index = SMALL.chars().position(|small| small == c)?;
    "0123456789-".chars().nth(index)
}

/// Strokes of a character in units of the capitals' height, origin on the baseline; empty for blanks.
/// Characters that the font lacks are drawn as a box.
pub fn strokes(c: char) -> Vec<[[f64; 2]; 2]> {
    if let Some(base) = exponent_of(c) {
        let [size, lift] = EXPONENT;
        let place = |[x, y]: [f64; 2]| [size * x, size * y + lift];
        return strokes(base).into_iter().map(|segment| segment.map(place)).collect();
    }
    let mut segments = Vec::new();
    for polyline in glyph(c).split_whitespace() {
        let points: Vec<[f64; 2]> = polyline
            .as_bytes()
            .chunks_exact(2)
            .map(|pair| [digit(pair[0]) / CAPITAL, (digit(pair[1]) - BASELINE) / CAPITAL])
            .collect();
        if let [only] = points[..] {
            segments.push([only, only]);
        }
        segments.extend(points.windows(2).map(|pair| [pair[0], pair[1]]));
    }
    segments
}

/// Distance from a character's origin to the next one's, in units of the capitals' height.
pub fn advance(c: char) -> f64 {
    if c == ' ' {
        return 4.0 / CAPITAL;
    }
    if let Some(base) = exponent_of(c) {
        return EXPONENT[0] * advance(base);
    }
    let points = glyph(c).split_whitespace().flat_map(|polyline| polyline.as_bytes().chunks_exact(2));
    let right = points.map(|pair| digit(pair[0])).fold(0.0, f64::max);
    (right + GAP) / CAPITAL
}

/// Width of a text in units of the capitals' height.
pub fn width(text: &str) -> f64 {
    text.chars().map(advance).sum::<f64>() - if text.is_empty() { 0.0 } else { GAP / CAPITAL }
}

fn digit(hexadecimal: u8) -> f64 {
    f64::from(char::from(hexadecimal).to_digit(16).unwrap_or(0))
}

/// Strokes of a character; a box where it is lacking.
fn glyph(c: char) -> &'static str {
    GLYPHS.iter().find(|(known, _)| *known == c).map_or("030c6c6303", |(_, strokes)| *strokes)
}

/// Polylines of every character, two hexadecimal digits (across, up) per point.
const GLYPHS: &[(char, &str)] = &[
    (' ', ""),
    ('0', "2314050a1b2c4c5b6a65544323"),
    ('1', "0a2c23 0343"),
    ('2', "0a1b2c4c5b6a690363"),
    ('3', "0b1c4c5b594828 48666554431304"),
    ('4', "4c0666 4c43"),
    ('5', "5c0c0848666554431304"),
    ('6', "5b4c2c1b0a051423435465665748281706"),
    ('7', "0c6c23"),
    ('8', "28191b2c4c5b594828 28060514234354656648"),
    ('9', "14234354656a5b4c2c1b0a091827475869"),
    ('A', "033c63 1656"),
    ('B', "030c4c5b594808 486665544303"),
    ('C', "6a5b4c2c1b0a051423435465"),
    ('D', "030c4c5b6a65544303"),
    ('E', "6c0c0363 0848"),
    ('F', "6c0c03 0848"),
    ('G', "6a5b4c2c1b0a0514234354656737"),
    ('H', "0c03 6c63 0868"),
    ('I', "0c4c 2c23 0343"),
    ('J', "5c54431304"),
    ('K', "0c03 6c06 2863"),
    ('L', "0c0363"),
    ('M', "030c366c63"),
    ('N', "030c636c"),
    ('O', "2314050a1b2c4c5b6a65544323"),
    ('P', "030c4c5b6a68574707"),
    ('Q', "2314050a1b2c4c5b6a65544323 3663"),
    ('R', "030c4c5b6a68574707 3763"),
    ('S', "6a5b4c2c1b0a0918485766655443231405"),
    ('T', "0c6c 3c33"),
    ('U', "0c0514234354656c"),
    ('V', "0c336c"),
    ('W', "0c234a638c"),
    ('X', "0c63 6c03"),
    ('Y', "0c376c 3733"),
    ('Z', "0c6c0363"),
    ('a', "5953 5849190804134354"),
    ('b', "0c03 0819495854431304"),
    ('c', "5849190804134354"),
    ('d', "5c53 5849190804134354"),
    ('e', "06565849190804134354"),
    ('f', "4b3c2c1b13 0939"),
    ('g', "5951401001 5849190804134354"),
    ('h', "0c03 0819495853"),
    ('i', "0903 0b"),
    ('j', "29211000 2b"),
    ('k', "0c03 4905 2743"),
    ('l', "0c0413"),
    ('m', "0903 0819394843 4859798883"),
    ('n', "0903 0819495853"),
    ('o', "130408194958544313"),
    ('p', "0900 0819495854431304"),
    ('q', "5950 5849190804134354"),
    ('r', "0903 08193949"),
    ('s', "584919080716465554431304"),
    ('t', "1c142333 0939"),
    ('u', "0904134354 5953"),
    ('v', "092349"),
    ('w', "0923476389"),
    ('x', "0953 5903"),
    ('y', "0923 591000"),
    ('z', "09590353"),
    // A square: a point as wide as a stroke is lost beside digits.
    ('.', "0313140403"),
    (',', "1402"),
    (':', "0313140403 0818190908"),
    (';', "1402 18"),
    ('+', "0666 3933"),
    ('=', "0858 0555"),
    ('(', "2d0b0422"),
    (')', "0d2b2402"),
    ('[', "2d0d0222"),
    (']', "0d2d2202"),
    ('/', "025d"),
    ('%', "035c 0b1c2b1a0b 3445544334"),
    ('<', "590653"),
    ('>', "095603"),
    ('\u{2265}', "0b5805 0353"),
    ('\u{2264}', "5b0855 0353"),
    ('^', "0a2c4a"),
    ('_', "0262"),
    ('\'', "0c0a"),
    ('"', "0c0a 2c2a"),
    ('!', "0c06 03"),
    ('?', "0b1c3c4b4a2826 23"),
    ('*', "2b27 0a48 4a08"),
    ('#', "1b13 4b43 0959 0555"),
    ('\u{b7}', "07"),
    ('\u{b0}', "0b1c2b1a0b"),
    ('\u{2013}', "0757"),
    ('-', "0646"),
    ('\u{2212}', "0646"),
    ('\u{3bc}', "0900 0413334455 5953"),
    ('\u{b5}', "0900 0413334455 5953"),
];

#[cfg(test)]
mod tests {
    use super::*;

    /// 10^-3 as legends write it has strokes of its own, small and raised: no box of a character that is
    /// lacking.
    #[test]
    fn exponents_are_drawn() {
        let lacking = strokes('\u{4e00}');
        for (small, base) in
            "\u{2070}\u{b9}\u{b2}\u{b3}\u{2074}\u{2075}\u{2076}\u{2077}\u{2078}\u{2079}\u{207b}"
                .chars()
                .zip("0123456789-".chars())
        {
            let (drawn, plain) = (strokes(small), strokes(base));
            assert!(drawn.len() == plain.len() && drawn != lacking, "{small}");
            let low = drawn.iter().flatten().map(|p| p[1]).fold(f64::INFINITY, f64::min);
            assert!(low > 0.5 && advance(small) < advance(base), "{small}");
        }
    }
}
