//! Axes: scale, range, ticks and the text of numbers.

/// How data map to a length on the page.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scale {
    /// In proportion.
    Linear,
    /// In proportion to the logarithm; data must be positive.
    Log,
}

/// An axis.
#[derive(Clone, Debug, PartialEq)]
pub struct Axis {
    /// What is measured, with the unit in brackets.
    pub label: String,
    /// Linear or logarithmic.
    pub scale: Scale,
    /// Ends of the axis; `None` takes them from the data.
    pub range: Option<[f64; 2]>,
}

/// Values beyond it, or on a logarithmic axis below its inverse, are not drawn: margins and steps of axes
/// stay numbers of full precision.
const LARGEST: f64 = 1e250;

/// A tick mark: where, and its text (empty for a minor tick).
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Tick {
    pub value: f64,
    pub text: String,
}

impl Axis {
    /// A linear axis with the range of the data.
    pub fn linear(label: impl Into<String>) -> Self {
        Self { label: label.into(), scale: Scale::Linear, range: None }
    }

    /// A logarithmic axis with the range of the data.
    pub fn log(label: impl Into<String>) -> Self {
        Self { label: label.into(), scale: Scale::Log, range: None }
    }

    /// The same with fixed ends.
    pub fn between(mut self, low: f64, high: f64) -> Self {
        self.range = Some([low, high]);
        self
    }

    /// Whether a value can be drawn on this axis.
    pub(super) fn shows(&self, value: f64) -> bool {
        value.abs() <= LARGEST && (self.scale == Scale::Linear || value >= 1.0 / LARGEST)
    }

    /// The value on the scale: itself, or its decimal logarithm.
    pub(super) fn position(&self, value: f64) -> f64 {
        match self.scale {
            Scale::Linear => value,
            Scale::Log => value.log10(),
        }
    }

    /// The ends of the axis: the given ones, else those of the data with a margin; `None` where nothing can
    /// be drawn.
    pub(super) fn limits(&self, data: impl Iterator<Item = f64>) -> Option<[f64; 2]> {
        if let Some([low, high]) =
            self.range.filter(|[low, high]| self.shows(*low) && self.shows(*high) && low < high)
        {
            return Some([low, high]);
        }
        let (low, high) = data
            .filter(|&value| self.shows(value))
            .map(|value| self.position(value))
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), p| (low.min(p), high.max(p)));
        if low > high {
            return None;
        }
        match self.scale {
            Scale::Linear => {
                let spread = if high - low >= 1.0 / LARGEST { high - low } else { low.abs().max(1.0) };
                let step = nice_step(spread / 5.0);
                // Ends on a tick unless that would waste much of the axis; zero is kept as an end.
                let down = ((low / step).floor() * step).max(low - 0.3 * spread);
                let up = ((high / step).ceil() * step).min(high + 0.3 * spread);
                Some(if down < up { [down, up] } else { [low - 0.5 * spread, high + 0.5 * spread] })
            }
            Scale::Log => {
                let margin = (0.04 * (high - low)).max(0.05);
                Some([10_f64.powf(low - margin), 10_f64.powf(high + margin)])
            }
        }
    }

    /// Ticks between the ends.
    pub(crate) fn ticks(&self, [low, high]: [f64; 2]) -> Vec<Tick> {
        match self.scale {
            Scale::Linear => {
                let step = nice_step((high - low) / 5.0);
                let first = (low / step - 1e-9).ceil() as i64;
                let last = (high / step + 1e-9).floor() as i64;
                (first..=last)
                    .map(|i| Tick { value: i as f64 * step, text: number_with_step(i as f64 * step, step) })
                    .collect()
            }
            Scale::Log => log_ticks(low, high),
        }
    }
}

/// 1, 2 or 5 times a power of ten, the smallest that is at least `rough`.
fn nice_step(rough: f64) -> f64 {
    let power = 10_f64.powf(rough.log10().floor());
    let digit = [1.0, 2.0, 5.0, 10.0].into_iter().find(|digit| digit * power >= rough * (1.0 - 1e-9));
    digit.unwrap_or(10.0) * power
}

fn log_ticks(low: f64, high: f64) -> Vec<Tick> {
    let (first, last) = (low.log10().floor() as i32, high.log10().ceil() as i32);
    let decades = high.log10() - low.log10();
    // Label every decade, every second one, ...; below two decades also 2 and 5.
    let stride = ((decades / 7.0).ceil() as i32).max(1);
    let labelled: &[i32] = match decades {
        d if d < 0.7 => &[1, 2, 3, 4, 5, 6, 7, 8, 9],
        d if d < 2.0 => &[1, 2, 5],
        _ => &[1],
    };
    // One notation along an axis: powers of ten where plain numbers would get long.
    let powers = decades >= 2.0 && (first < -3 || last > 4);
    let mut ticks = Vec::new();
    for exponent in first..=last {
        for digit in 1..=9 {
            let value = f64::from(digit) * 10_f64.powi(exponent);
            if value < low * (1.0 - 1e-9) || value > high * (1.0 + 1e-9) || (stride > 1 && digit > 1) {
                continue;
            }
            let shown = labelled.contains(&digit) && exponent.rem_euclid(stride) == 0;
            let text = match (shown, powers) {
                (false, _) => String::new(),
                (true, true) => format!("10{}", superscript(&exponent.to_string())),
                (true, false) => number(value),
            };
            ticks.push(Tick { value, text });
        }
    }
    ticks
}

/// A number with as many decimals as multiples of `step` need.
fn number_with_step(value: f64, step: f64) -> String {
    if value.abs() >= 1e5 || step < 1e-4 {
        return number(value);
    }
    let decimals = (-step.log10().floor()).max(0.0) as usize;
    let text = format!("{value:.decimals$}");
    if text.trim_start_matches('-').chars().all(|c| c == '0' || c == '.') {
        "0".into()
    } else {
        text.replace('-', "\u{2212}")
    }
}

/// A number as a person writes it: three significant digits, powers of ten beyond 1e-3..1e5.
pub fn number(value: f64) -> String {
    if value == 0.0 {
        return "0".into();
    }
    if !value.is_finite() {
        return "\u{2013}".into();
    }
    let size = value.abs();
    if (1e-3..99_999.5).contains(&size) {
        let decimals = (2 - size.log10().floor() as i32).max(0) as usize;
        let text = format!("{value:.decimals$}");
        let text = if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
        return text.replace('-', "\u{2212}");
    }
    let text = format!("{value:.2e}");
    let (mantissa, exponent) = text.split_once('e').unwrap_or((&text, "0"));
    let mantissa = mantissa.trim_end_matches('0').trim_end_matches('.').replace('-', "\u{2212}");
    let power = format!("10{}", superscript(exponent));
    match mantissa.as_str() {
        "1" => power,
        "\u{2212}1" => format!("\u{2212}{power}"),
        _ => format!("{mantissa}\u{b7}{power}"),
    }
}

fn superscript(digits: &str) -> String {
    const RAISED: [char; 10] = [
        '\u{2070}', '\u{b9}', '\u{b2}', '\u{b3}', '\u{2074}', '\u{2075}', '\u{2076}', '\u{2077}', '\u{2078}',
        '\u{2079}',
    ];
    digits
        .chars()
        .filter_map(|c| match c {
            '-' => Some('\u{207b}'),
            _ => c.to_digit(10).map(|digit| RAISED[digit as usize]),
        })
        .collect()
}
