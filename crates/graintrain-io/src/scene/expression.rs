//! Arithmetic with units: `"3 mm"`, `"2500 kg/m^3"`, `"(2*n + 1)*0.23 m"`, `"tip_speed/tip_radius * 1 rad"`.
//!
//! ```text
//! sum      = product { ("+" | "-") product }
//! product  = signed { ("*" | "/") signed }
//! signed   = { "+" | "-" } measured
//! measured = power { unit [ "^" exponent ] }        a unit written after a value binds tighter than * and /
//! power    = atom [ "^" exponent ]
//! exponent = { "+" | "-" } atom [ "^" exponent ]
//! atom     = number | parameter | unit | "pi" | function "(" sum { "," sum } ")" | "(" sum ")"
//! ```
//! So `10 cm/s` is a speed, `9.81 m/s^2` an acceleration and `1 m / 2 s` is 0.5 m/s.

use super::error::closest;
use super::quantity::{Dimension, Quantity, unit, unit_symbols};
use std::ops::Range;

/// Nesting deeper than this is refused (it would exhaust the stack).
const DEEPEST_NESTING: usize = 64;

const FUNCTIONS: &[&str] =
    &["abs", "acos", "asin", "atan", "ceil", "cos", "floor", "max", "min", "round", "sin", "sqrt", "tan"];

/// What is wrong with an expression, and where in its text.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ExpressionError {
    pub problem: String,
    pub span: Range<usize>,
}

/// Whether a parameter may not have this name because it already means something.
pub(crate) fn is_reserved(name: &str) -> bool {
    name == "pi" || unit(name).is_some() || FUNCTIONS.contains(&name)
}

/// Whether a word can be the name of a parameter: a letter or underscore, then letters, digits and underscores.
pub(crate) fn is_name(word: &str) -> bool {
    word.starts_with(|first: char| first.is_ascii_alphabetic() || first == '_')
        && word.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
}

/// Where the values of parameters come from.
pub(crate) trait Names {
    /// Value of the parameter; `None` if there is none of this name.
    fn value(&self, name: &str) -> Option<Result<Quantity, String>>;
    /// All parameters, for suggestions.
    fn names(&self) -> Vec<&str>;
}

/// No parameters: only units have names.
pub(crate) struct NoNames;

impl Names for NoNames {
    fn value(&self, _name: &str) -> Option<Result<Quantity, String>> {
        None
    }

    fn names(&self) -> Vec<&str> {
        Vec::new()
    }
}

/// Evaluates an expression.
pub(crate) fn evaluate(text: &str, names: &dyn Names) -> Result<Quantity, ExpressionError> {
    let tokens = tokenize(text)?;
    let mut parser = Parser { text, tokens, next: 0, depth: 0, names };
    let value = parser.sum()?;
    match parser.peek() {
        None => Ok(value),
        Some(token) => {
            let problem = match &token.kind {
                Kind::Word(word) if names.value(word).is_some() => {
                    format!("an operator is missing before `{word}`: write `* {word}`")
                }
                Kind::Word(word) => parser.unknown_word(word),
                Kind::Number(_) => "an operator is missing before this number".into(),
                Kind::Symbol('(') => "an operator is missing before `(`".into(),
                Kind::Symbol(symbol) => format!("unexpected `{symbol}`"),
            };
            Err(ExpressionError { problem, span: token.span.clone() })
        }
    }
}

#[derive(Clone, Debug)]
enum Kind {
    Number(f64),
    Word(String),
    Symbol(char),
}

#[derive(Clone, Debug)]
struct Token {
    kind: Kind,
    span: Range<usize>,
}

fn tokenize(text: &str) -> Result<Vec<Token>, ExpressionError> {
    let mut tokens = Vec::new();
    let mut rest = text;
    while let Some(first) = rest.chars().next() {
        let start = text.len() - rest.len();
        let length = if first.is_whitespace() {
            rest = &rest[first.len_utf8()..];
            continue;
        } else if first.is_ascii_digit() || first == '.' {
            number_length(rest)
        } else if first.is_alphabetic() || first == '_' {
            rest.find(|c: char| !(c.is_alphanumeric() || c == '_')).unwrap_or(rest.len())
        } else {
            first.len_utf8()
        };
        let span = start..start + length;
        let word = &rest[..length];
        let kind = if first.is_ascii_digit() || first == '.' {
            Kind::Number(word.parse().map_err(|_| ExpressionError {
                problem: format!("`{word}` is not a number"),
                span: span.clone(),
            })?)
        } else if first.is_alphabetic() || first == '_' {
            Kind::Word(word.to_string())
        } else if "+-*/^(),".contains(first) {
            Kind::Symbol(first)
        } else {
            return Err(ExpressionError { problem: format!("unexpected `{first}`"), span });
        };
        tokens.push(Token { kind, span });
        rest = &rest[length..];
    }
    Ok(tokens)
}

/// Length of the number at the start of the text: digits, point, and an exponent if it is complete (`2e3`, not the
/// `e` of a word).
fn number_length(text: &str) -> usize {
    let bytes = text.as_bytes();
    let digits = |mut at: usize| {
        while bytes.get(at).is_some_and(u8::is_ascii_digit) {
            at += 1;
        }
        at
    };
    let mut end = digits(0);
    if bytes.get(end) == Some(&b'.') {
        end = digits(end + 1);
    }
    if matches!(bytes.get(end), Some(b'e' | b'E')) {
        let sign = usize::from(matches!(bytes.get(end + 1), Some(b'+' | b'-')));
        let exponent_end = digits(end + 1 + sign);
        if exponent_end > end + 1 + sign {
            end = exponent_end;
        }
    }
    end
}

struct Parser<'a> {
    text: &'a str,
    tokens: Vec<Token>,
    next: usize,
    depth: usize,
    names: &'a dyn Names,
}

impl Parser<'_> {
    fn peek(&self) -> Option<&Token> {
        self.tokens.get(self.next)
    }

    fn take(&mut self, symbol: char) -> Option<Range<usize>> {
        match self.peek() {
            Some(Token { kind: Kind::Symbol(found), span }) if *found == symbol => {
                let span = span.clone();
                self.next += 1;
                Some(span)
            }
            _ => None,
        }
    }

    fn fail<T>(&self, problem: impl Into<String>, span: Range<usize>) -> Result<T, ExpressionError> {
        Err(ExpressionError { problem: problem.into(), span })
    }

    /// Where the input ended too early.
    fn end(&self) -> Range<usize> {
        let end = self.text.len();
        end.saturating_sub(1)..end
    }

    fn sum(&mut self) -> Result<Quantity, ExpressionError> {
        self.depth += 1;
        if self.depth > DEEPEST_NESTING {
            return self.fail("nested too deeply", 0..self.text.len());
        }
        let mut total = self.product()?;
        loop {
            let (sign, span) = if let Some(span) = self.take('+') {
                (1.0, span)
            } else if let Some(span) = self.take('-') {
                (-1.0, span)
            } else {
                break;
            };
            let term = self.product()?;
            if term.dimension != total.dimension {
                let problem = format!("cannot add {} and {}", total.dimension, term.dimension);
                return self.fail(problem, span);
            }
            total.value += sign * term.value;
        }
        self.depth -= 1;
        Ok(total)
    }

    fn product(&mut self) -> Result<Quantity, ExpressionError> {
        let mut total = self.signed()?;
        loop {
            let (result, span) = if let Some(span) = self.take('*') {
                (total.multiply(self.signed()?), span)
            } else if let Some(span) = self.take('/') {
                (total.divide(self.signed()?), span)
            } else {
                return Ok(total);
            };
            total = result.or_else(|problem| self.fail(problem, span))?;
        }
    }

    fn sign(&mut self) -> f64 {
        let mut sign = 1.0;
        loop {
            if self.take('-').is_some() {
                sign = -sign;
            } else if self.take('+').is_none() {
                return sign;
            }
        }
    }

    fn signed(&mut self) -> Result<Quantity, ExpressionError> {
        let sign = self.sign();
        let mut value = self.measured()?;
        value.value *= sign;
        Ok(value)
    }

    fn measured(&mut self) -> Result<Quantity, ExpressionError> {
        let mut total = self.power()?;
        while let Some(Token { kind: Kind::Word(word), span }) = self.peek() {
            let Some(mut factor) = unit(word).filter(|_| self.names.value(word).is_none()) else { break };
            let span = span.clone();
            self.next += 1;
            if self.take('^').is_some() {
                let exponent = self.exponent()?;
                factor = factor.power(exponent).or_else(|problem| self.fail(problem, span.clone()))?;
            }
            total = total.multiply(factor).or_else(|problem| self.fail(problem, span))?;
        }
        Ok(total)
    }

    fn power(&mut self) -> Result<Quantity, ExpressionError> {
        let base = self.atom()?;
        match self.take('^') {
            Some(span) => {
                let exponent = self.exponent()?;
                base.power(exponent).or_else(|problem| self.fail(problem, span))
            }
            None => Ok(base),
        }
    }

    fn exponent(&mut self) -> Result<Quantity, ExpressionError> {
        self.depth += 1;
        if self.depth > DEEPEST_NESTING {
            return self.fail("nested too deeply", 0..self.text.len());
        }
        let sign = self.sign();
        let mut value = self.power()?;
        value.value *= sign;
        self.depth -= 1;
        Ok(value)
    }

    fn atom(&mut self) -> Result<Quantity, ExpressionError> {
        let Some(Token { kind, span }) = self.peek().cloned() else {
            let problem = if self.tokens.is_empty() { "it is empty" } else { "it ends too early" };
            return self.fail(problem, self.end());
        };
        self.next += 1;
        match kind {
            Kind::Number(value) => Ok(Quantity::number(value)),
            Kind::Symbol('(') => {
                let value = self.sum()?;
                match self.take(')') {
                    Some(_) => Ok(value),
                    None => self.fail("this parenthesis is not closed", span),
                }
            }
            Kind::Symbol(symbol) => self.fail(format!("unexpected `{symbol}`"), span),
            Kind::Word(word) if FUNCTIONS.contains(&word.as_str()) => self.call(&word, span),
            Kind::Word(word) => {
                if let Some(value) = self.names.value(&word) {
                    value.or_else(|problem| self.fail(problem, span))
                } else if let Some(value) = unit(&word) {
                    Ok(value)
                } else if word == "pi" {
                    Ok(Quantity::number(std::f64::consts::PI))
                } else {
                    self.fail(self.unknown_word(&word), span)
                }
            }
        }
    }

    fn unknown_word(&self, word: &str) -> String {
        let stem = word.trim_end_matches(|c: char| c.is_ascii_digit());
        let known: Vec<&str> =
            [self.names.names(), unit_symbols().collect::<Vec<&str>>(), FUNCTIONS.to_vec()].concat();
        match (unit(stem), closest(word, known)) {
            (Some(_), _) if stem != word => {
                format!("`{word}` is no unit; write the power as `{stem}^{}`", &word[stem.len()..])
            }
            (_, Some(closest)) => {
                format!("`{word}` is neither a unit nor a parameter; did you mean `{closest}`?")
            }
            _ => format!("`{word}` is neither a unit nor a parameter"),
        }
    }

    fn call(&mut self, function: &str, span: Range<usize>) -> Result<Quantity, ExpressionError> {
        if self.take('(').is_none() {
            return self.fail(format!("`{function}` is a function: write `{function}(...)`"), span);
        }
        let mut arguments = vec![self.sum()?];
        while self.take(',').is_some() {
            arguments.push(self.sum()?);
        }
        if self.take(')').is_none() {
            return self.fail(format!("the parenthesis of `{function}` is not closed"), span);
        }
        apply(function, &arguments).or_else(|problem| self.fail(problem, span))
    }
}

fn apply(function: &str, arguments: &[Quantity]) -> Result<Quantity, String> {
    let first = arguments[0];
    if matches!(function, "min" | "max") {
        return arguments[1..].iter().try_fold(first, |best, &next| {
            if next.dimension != best.dimension {
                return Err(format!("`{function}` of {} and {}", best.dimension, next.dimension));
            }
            let value =
                if function == "min" { best.value.min(next.value) } else { best.value.max(next.value) };
            Ok(Quantity { value, ..best })
        });
    }
    if arguments.len() > 1 {
        return Err(format!("`{function}` takes one value, got {}", arguments.len()));
    }
    let pure = |f: fn(f64) -> f64| match first.dimension {
        Dimension::NONE => Ok(Quantity::number(f(first.value))),
        other => Err(format!("`{function}` takes a number without unit, got {other}")),
    };
    let of_angle = |f: fn(f64) -> f64| match first.dimension {
        Dimension::NONE | Dimension::ANGLE => Ok(Quantity::number(f(first.value))),
        other => Err(format!("`{function}` takes an angle, got {other}")),
    };
    let to_angle = |f: fn(f64) -> f64| {
        pure(f).map(|number| Quantity { value: number.value, dimension: Dimension::ANGLE })
    };
    match function {
        "abs" => Ok(Quantity { value: first.value.abs(), ..first }),
        "sqrt" => first.square_root(),
        "floor" => pure(f64::floor),
        "ceil" => pure(f64::ceil),
        "round" => pure(f64::round),
        "sin" => of_angle(f64::sin),
        "cos" => of_angle(f64::cos),
        "tan" => of_angle(f64::tan),
        "asin" => to_angle(f64::asin),
        "acos" => to_angle(f64::acos),
        "atan" => to_angle(f64::atan),
        _ => Err(format!("`{function}` is not a function")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    struct One;

    impl Names for One {
        fn value(&self, name: &str) -> Option<Result<Quantity, String>> {
            (name == "n").then_some(Ok(Quantity::number(8.0)))
        }

        fn names(&self) -> Vec<&str> {
            vec!["n"]
        }
    }

    fn value(text: &str) -> f64 {
        evaluate(text, &One).unwrap_or_else(|error| panic!("{text}: {}", error.problem)).value
    }

    #[test]
    fn arithmetic_with_units() {
        let close = |text: &str, expected: f64| {
            let found = value(text);
            assert!((found - expected).abs() <= 1e-14 * expected.abs(), "{text}: {found}");
        };
        close("(2*n+1)*0.23 m", 3.91);
        close("1 m / 2 s", 0.5);
        close("-2^2", -4.0);
        close("2^-1", 0.5);
        close("2^3^2", 512.0);
        close("2500 kg/m^3", 2500.0);
        close("1 - 2 - 3", -4.0);
        close("8 / 2 / 2", 2.0);
        close("12 rpm", 12.0 * std::f64::consts::TAU / 60.0);
        close("sin(30 deg) + sqrt(4 m^2) / 1 m + max(1, n, 3)", 10.5);
        close("2e3 mm", 2.0);
    }

    proptest! {
        #[test]
        fn every_unit_scales_its_number(number in -1e6..1e6_f64, which in 0..unit_symbols().count()) {
            let symbol = unit_symbols().nth(which).unwrap();
            let found = evaluate(&format!("{number} {symbol}"), &One).unwrap();
            let expected = unit(symbol).unwrap();
            prop_assert_eq!(found.dimension, expected.dimension);
            prop_assert_eq!(found.value, number * expected.value);
            // Written in SI it is the same.
            let again = evaluate(&format!("{} * {}", found.value, found.dimension.unit()), &One).unwrap();
            prop_assert_eq!(again.value, found.value);
        }

        #[test]
        fn any_text_gives_a_value_or_a_problem_inside_the_text(text in "[-+*/^() 0-9a-zµ.,]{0,40}") {
            if let Err(error) = evaluate(&text, &One) {
                prop_assert!(!error.problem.is_empty());
                prop_assert!(error.span.start <= error.span.end && error.span.end <= text.len());
            }
        }
    }
}
