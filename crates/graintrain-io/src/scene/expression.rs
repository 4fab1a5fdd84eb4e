//! Arithmetic with units: `"3 mm"`, `"2500 kg/m^3"`, `"(2*n + 1)*0.23 m"`, `"tip_speed/tip_radius * 1 rad"`.
//!
//! ```text
//! sum      = product { ("+" | "-") product }
//! product  = signed { ("*" | "/") signed }
//! signed   = { "+" | "-" } measured
//! measured = power { unit [ "^" exponent ] }        a unit written after a value binds tighter than * and /
//! power    = atom [ "^" exponent ]
//! exponent = { "+" | "-" } atom [ "^" exponent ]
//! atom     = number | parameter | unit | "pi" | function "(" sum { "," sum } ")" | extent "(" parameter ")" | "(" sum ")"
//! ```
//! An extent (`mesh_min_x` to `mesh_max_z`) is the least or greatest coordinate in the file of triangles that
//! a parameter names, a number in the unit of the file. In a function of time the atom `t` is the time
//! (elsewhere it is the unit, a tonne): `"2 kN * sin(2*pi*t/4 s)"`.
//!
//! So `10 cm/s` is a speed, `9.81 m/s^2` an acceleration and `1 m / 2 s` is 0.5 m/s.

use super::error::closest;
use super::quantity::{Dimension, Quantity, unit, unit_symbols};
use graintrain::formula::{Formula, Function, Operation, Operator};
use graintrain::math::Vec3;
use std::ops::Range;

/// Nesting deeper than this is refused (it would exhaust the stack).
const DEEPEST_NESTING: usize = 64;

const FUNCTIONS: &[&str] = &[
    "abs", "acos", "asin", "atan", "ceil", "cos", "exp", "floor", "ln", "max", "min", "round", "sin", "sqrt",
    "tan",
];

/// Least and greatest coordinates in a file of triangles, by axis.
const EXTENTS: [[&str; 2]; 3] =
    [["mesh_min_x", "mesh_max_x"], ["mesh_min_y", "mesh_max_y"], ["mesh_min_z", "mesh_max_z"]];

/// Whether it is the least (0) or greatest (1) coordinate, and along which axis.
fn extent(word: &str) -> Option<(usize, usize)> {
    (0..3).find_map(|axis| Some((axis, EXTENTS[axis].iter().position(|name| *name == word)?)))
}

/// The name of the time in functions of it.
const TIME: &str = "t";

/// What is wrong with an expression, and where in its text.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ExpressionError {
    pub problem: String,
    pub span: Range<usize>,
}

/// Whether a parameter may not have this name because it already means something.
pub(crate) fn is_reserved(name: &str) -> bool {
    name == "pi" || unit(name).is_some() || FUNCTIONS.contains(&name) || extent(name).is_some()
}

/// Whether a word can be the name of a parameter: a letter or underscore, then letters, digits and
/// underscores.
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
    /// Least and greatest coordinates in the file of triangles that the parameter of this name names; `None`
    /// if there is no such parameter.
    fn corners(&self, _name: &str) -> Option<Result<[Vec3; 2], String>> {
        None
    }
    /// What a name stands for, in messages.
    fn kind(&self) -> &'static str {
        "a parameter"
    }
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

/// A value with its dimension, as the operations that make it from the time. Operations on numbers alone are
/// made at once, so that what does not depend on time is one number.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Term {
    pub dimension: Dimension,
    pub operations: Vec<Operation>,
}

impl From<Quantity> for Term {
    fn from(quantity: Quantity) -> Self {
        Self { dimension: quantity.dimension, operations: vec![Operation::Number(quantity.value)] }
    }
}

impl Term {
    /// The value where it does not depend on time.
    pub fn constant(&self) -> Option<Quantity> {
        match self.operations.as_slice() {
            &[Operation::Number(value)] => Some(Quantity { value, dimension: self.dimension }),
            _ => None,
        }
    }

    /// A value of the same dimension to try dimensions with, never zero.
    fn sample(&self) -> Quantity {
        self.constant().unwrap_or(Quantity { value: 1.0, dimension: self.dimension })
    }

    /// `quantities` joins numbers (and dimensions, for which any numbers do), `operator` what depends on
    /// time.
    fn joined(
        self,
        other: Self,
        operator: Operator,
        quantities: impl Fn(Quantity, Quantity) -> Result<Quantity, String>,
    ) -> Result<Self, String> {
        let result = quantities(self.sample(), other.sample())?;
        if self.constant().is_some() && other.constant().is_some() {
            return Ok(result.into());
        }
        // Dividing by one unit takes a dimension away and leaves the number.
        let by_one = operator == Operator::Divide && other.operations == [Operation::Number(1.0)];
        let mut operations = self.operations;
        if !by_one {
            operations.extend(other.operations);
            operations.push(Operation::Operator(operator));
        }
        Ok(Self { dimension: result.dimension, operations })
    }

    fn negated(mut self) -> Self {
        match self.operations.as_mut_slice() {
            [Operation::Number(value)] => *value *= -1.0,
            _ => {
                self.operations.push(Operation::Number(-1.0));
                self.operations.push(Operation::Operator(Operator::Multiply));
            }
        }
        self
    }
}

/// Evaluates an expression.
pub(crate) fn evaluate(text: &str, names: &dyn Names) -> Result<Quantity, ExpressionError> {
    let term = parse(text, names, false)?;
    // Without a time everything is a number.
    Ok(term.constant().unwrap_or(Quantity { value: f64::NAN, dimension: term.dimension }))
}

/// Compiles a function of the time `t`.
pub(crate) fn compile(text: &str, names: &dyn Names) -> Result<Term, ExpressionError> {
    parse(text, names, true)
}

/// The formula as a text that [`compile`] turns into the same operations, whatever is asked for in SI units.
pub(crate) fn formula_text(formula: &Formula) -> String {
    let mut stack: Vec<String> = Vec::new();
    for operation in formula.operations() {
        let text = match *operation {
            Operation::Number(number) => format!("{number:?}"),
            Operation::Time => "(t / 1 s)".to_string(),
            Operation::Function(function) => {
                let x = stack.pop().unwrap_or_default();
                let name = Function::NAMES.iter().find(|(_, known)| *known == function).map_or("", |f| f.0);
                match function {
                    Function::Asin | Function::Acos | Function::Atan => format!("({name}({x}) / 1 rad)"),
                    _ => format!("{name}({x})"),
                }
            }
            Operation::Operator(operator) => {
                let b = stack.pop().unwrap_or_default();
                let a = stack.pop().unwrap_or_default();
                match operator {
                    Operator::Add => format!("({a} + {b})"),
                    Operator::Subtract => format!("({a} - {b})"),
                    Operator::Multiply => format!("({a} * {b})"),
                    Operator::Divide => format!("({a} / {b})"),
                    Operator::Power => format!("(({a})^({b}))"),
                    Operator::Minimum => format!("min({a}, {b})"),
                    Operator::Maximum => format!("max({a}, {b})"),
                }
            }
        };
        stack.push(text);
    }
    stack.pop().unwrap_or_default()
}

fn parse(text: &str, names: &dyn Names, of_time: bool) -> Result<Term, ExpressionError> {
    let tokens = tokenize(text)?;
    let mut parser = Parser { text, tokens, next: 0, depth: 0, names, of_time };
    let value = parser.sum()?;
    match parser.peek() {
        None => Ok(value),
        Some(token) => {
            let problem = match &token.kind {
                Kind::Word(word) if names.value(word).is_some() || parser.is_time(word) => {
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

/// Length of the number at the start of the text: digits, point, and an exponent if it is complete (`2e3`,
/// not the `e` of a word).
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
    /// Whether `t` is the time.
    of_time: bool,
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

    /// Whether a word is the time.
    fn is_time(&self, word: &str) -> bool {
        self.of_time && word == TIME
    }

    fn sum(&mut self) -> Result<Term, ExpressionError> {
        self.depth += 1;
        if self.depth > DEEPEST_NESTING {
            return self.fail("nested too deeply", 0..self.text.len());
        }
        let mut total = self.product()?;
        loop {
            let (sign, operator, span) = if let Some(span) = self.take('+') {
                (1.0, Operator::Add, span)
            } else if let Some(span) = self.take('-') {
                (-1.0, Operator::Subtract, span)
            } else {
                break;
            };
            let term = self.product()?;
            if term.dimension != total.dimension {
                let problem = format!("cannot add {} and {}", total.dimension, term.dimension);
                return self.fail(problem, span);
            }
            let add = |a: Quantity, b: Quantity| Ok(Quantity { value: a.value + sign * b.value, ..a });
            total = total.joined(term, operator, add).or_else(|problem| self.fail(problem, span))?;
        }
        self.depth -= 1;
        Ok(total)
    }

    fn product(&mut self) -> Result<Term, ExpressionError> {
        let mut total = self.signed()?;
        loop {
            let (result, span) = if let Some(span) = self.take('*') {
                (total.joined(self.signed()?, Operator::Multiply, Quantity::multiply), span)
            } else if let Some(span) = self.take('/') {
                (total.joined(self.signed()?, Operator::Divide, Quantity::divide), span)
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

    fn signed(&mut self) -> Result<Term, ExpressionError> {
        let sign = self.sign();
        let value = self.measured()?;
        Ok(if sign < 0.0 { value.negated() } else { value })
    }

    fn measured(&mut self) -> Result<Term, ExpressionError> {
        let mut total = self.power()?;
        while let Some(Token { kind: Kind::Word(word), span }) = self.peek() {
            let known = self.names.value(word).is_some() || self.is_time(word);
            let Some(factor) = unit(word).filter(|_| !known) else { break };
            let span = span.clone();
            self.next += 1;
            let mut factor = Term::from(factor);
            if self.take('^').is_some() {
                factor = self.raised(factor, span.clone())?;
            }
            total = total
                .joined(factor, Operator::Multiply, Quantity::multiply)
                .or_else(|problem| self.fail(problem, span))?;
        }
        Ok(total)
    }

    fn power(&mut self) -> Result<Term, ExpressionError> {
        let base = self.atom()?;
        match self.take('^') {
            Some(span) => self.raised(base, span),
            None => Ok(base),
        }
    }

    /// The base to the power of the exponent that follows.
    fn raised(&mut self, base: Term, span: Range<usize>) -> Result<Term, ExpressionError> {
        let exponent = self.exponent()?;
        if exponent.constant().is_none() && base.dimension != Dimension::NONE {
            return self.fail("an exponent that depends on time needs a base without unit", span);
        }
        base.joined(exponent, Operator::Power, Quantity::power).or_else(|problem| self.fail(problem, span))
    }

    fn exponent(&mut self) -> Result<Term, ExpressionError> {
        self.depth += 1;
        if self.depth > DEEPEST_NESTING {
            return self.fail("nested too deeply", 0..self.text.len());
        }
        let sign = self.sign();
        let value = self.power()?;
        self.depth -= 1;
        Ok(if sign < 0.0 { value.negated() } else { value })
    }

    fn atom(&mut self) -> Result<Term, ExpressionError> {
        let Some(Token { kind, span }) = self.peek().cloned() else {
            let problem = if self.tokens.is_empty() { "it is empty" } else { "it ends too early" };
            return self.fail(problem, self.end());
        };
        self.next += 1;
        match kind {
            Kind::Number(value) => Ok(Quantity::number(value).into()),
            Kind::Symbol('(') => {
                let value = self.sum()?;
                match self.take(')') {
                    Some(_) => Ok(value),
                    None => self.fail("this parenthesis is not closed", span),
                }
            }
            Kind::Symbol(symbol) => self.fail(format!("unexpected `{symbol}`"), span),
            Kind::Word(word) if FUNCTIONS.contains(&word.as_str()) => self.call(&word, span),
            Kind::Word(word) if extent(&word).is_some() => self.extent(&word, span),
            Kind::Word(word) => {
                if let Some(value) = self.names.value(&word) {
                    value.map(Term::from).or_else(|problem| self.fail(problem, span))
                } else if self.is_time(&word) {
                    Ok(Term { dimension: Dimension::TIME, operations: vec![Operation::Time] })
                } else if let Some(value) = unit(&word) {
                    Ok(value.into())
                } else if word == "pi" {
                    Ok(Quantity::number(std::f64::consts::PI).into())
                } else {
                    self.fail(self.unknown_word(&word), span)
                }
            }
        }
    }

    fn unknown_word(&self, word: &str) -> String {
        let stem = word.trim_end_matches(|c: char| c.is_ascii_digit());
        let known: Vec<&str> =
            [self.names.names(), unit_symbols().collect(), FUNCTIONS.to_vec(), EXTENTS.concat()].concat();
        let kind = self.names.kind();
        match (unit(stem), closest(word, known)) {
            (Some(_), _) if stem != word => {
                format!("`{word}` is no unit; write the power as `{stem}^{}`", &word[stem.len()..])
            }
            (_, Some(closest)) => {
                format!("`{word}` is neither a unit nor {kind}; did you mean `{closest}`?")
            }
            _ => format!("`{word}` is neither a unit nor {kind}"),
        }
    }

    /// The extent of a file: `mesh_max_x(path)`.
    fn extent(&mut self, function: &str, span: Range<usize>) -> Result<Term, ExpressionError> {
        let named = match (self.take('('), self.peek().map(|token| token.kind.clone())) {
            (Some(_), Some(Kind::Word(name))) => {
                self.next += 1;
                self.take(')').map(|_| name)
            }
            _ => None,
        };
        let (Some(name), Some((axis, end))) = (named, extent(function)) else {
            let problem = format!("`{function}` takes the parameter that names a file: `{function}(path)`");
            return self.fail(problem, span);
        };
        match self.names.corners(&name) {
            Some(Ok(corners)) => Ok(Quantity::number(corners[end][axis]).into()),
            Some(Err(problem)) => self.fail(problem, span),
            None => self.fail(format!("`{name}` is no parameter that names a file of triangles"), span),
        }
    }

    fn call(&mut self, function: &str, span: Range<usize>) -> Result<Term, ExpressionError> {
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
        apply(function, arguments).or_else(|problem| self.fail(problem, span))
    }
}

fn apply(name: &str, arguments: Vec<Term>) -> Result<Term, String> {
    let count = arguments.len();
    let mut arguments = arguments.into_iter();
    let Some(first) = arguments.next() else { return Err(format!("`{name}` takes a value")) };
    if let Some(operator) = match name {
        "min" => Some(Operator::Minimum),
        "max" => Some(Operator::Maximum),
        _ => None,
    } {
        let choose = |best: Quantity, next: Quantity| {
            if next.dimension != best.dimension {
                return Err(format!("`{name}` of {} and {}", best.dimension, next.dimension));
            }
            Ok(Quantity { value: operator.value(best.value, next.value), ..best })
        };
        return arguments.try_fold(first, |best, next| best.joined(next, operator, choose));
    }
    if count > 1 {
        return Err(format!("`{name}` takes one value, got {count}"));
    }
    let Some(&(_, function)) = Function::NAMES.iter().find(|(known, _)| *known == name) else {
        return Err(format!("`{name}` is not a function"));
    };
    let dimension = match function {
        Function::Abs => first.dimension,
        Function::Sqrt => first.sample().square_root()?.dimension,
        Function::Sin | Function::Cos | Function::Tan => match first.dimension {
            Dimension::NONE | Dimension::ANGLE => Dimension::NONE,
            other => return Err(format!("`{name}` takes an angle, got {other}")),
        },
        _ => match first.dimension {
            Dimension::NONE if matches!(function, Function::Asin | Function::Acos | Function::Atan) => {
                Dimension::ANGLE
            }
            Dimension::NONE => Dimension::NONE,
            other => return Err(format!("`{name}` takes a number without unit, got {other}")),
        },
    };
    if let Some(quantity) = first.constant() {
        return Ok(Quantity { value: function.value(quantity.value), dimension }.into());
    }
    let mut operations = first.operations;
    operations.push(Operation::Function(function));
    Ok(Term { dimension, operations })
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
        close("exp(1) * ln(2) / exp(1) - ln(2) + ln(exp(3))", 3.0);
        close("2e3 mm", 2.0);
    }

    #[test]
    fn functions_of_time_have_dimensions_and_values() {
        type Case = (&'static str, Dimension, fn(f64) -> f64);
        let cases: [Case; 7] = [
            ("2 kN * sin(2*pi*t/4 s)", Dimension::FORCE, |t| {
                2000.0 * (2.0 * std::f64::consts::PI * t / 4.0).sin()
            }),
            ("-t * 3 N/s", Dimension::FORCE, |t| -t * 3.0),
            ("min(t, 2 s) / 4 s * 1 m/s", Dimension::SPEED, |t| t.min(2.0) / 4.0),
            ("(1 m + 2 m * t/1 s)^2 / 1 s^2", Dimension::new(2, 0, -2, 0), |t| (1.0 + 2.0 * t).powf(2.0)),
            ("sqrt(t^2 + 9 s^2) * 1 N/s", Dimension::FORCE, |t| (t.powf(2.0) + 9.0).sqrt()),
            ("atan(t/1 s) * n", Dimension::ANGLE, |t| t.atan() * 8.0),
            ("2^(t/1 s)", Dimension::NONE, |t| 2.0_f64.powf(t)),
        ];
        for (text, dimension, expected) in cases {
            let term = compile(text, &One).unwrap_or_else(|error| panic!("{text}: {}", error.problem));
            assert_eq!(term.dimension, dimension, "{text}");
            let formula = Formula::new(term.operations.clone()).unwrap();
            for time in [0.0, 0.3, 1.7, 12.0] {
                let (found, expected) = (formula.value(time), expected(time));
                assert!((found - expected).abs() <= 1e-15 * expected.abs(), "{text} at {time}: {found}");
            }
            // Written out and read again it is the same, operation by operation.
            let again = compile(&formula_text(&formula), &One).unwrap();
            assert_eq!(again.operations, term.operations, "{text}: {}", formula_text(&formula));
        }
        for bad in ["2 t", "t + 1 N", "2^t", "(1 m)^(t/1 s)", "sin(t)", "2*x"] {
            assert!(compile(bad, &One).is_err(), "{bad}");
        }
        assert_eq!(evaluate("3 t", &One).unwrap(), Quantity { value: 3000.0, dimension: Dimension::MASS });
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
