//! Formulas: scalar functions of time that a scene writes as text, compiled once and evaluated in every step.

use crate::error::ModelError;
use graintrain_linalg::real;
use serde::{Deserialize, Serialize};

/// A function of one number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Function {
    /// Magnitude.
    Abs,
    /// Square root.
    Sqrt,
    /// Largest whole number below.
    Floor,
    /// Smallest whole number above.
    Ceil,
    /// Nearest whole number.
    Round,
    /// Sine.
    Sin,
    /// Cosine.
    Cos,
    /// Tangent.
    Tan,
    /// Inverse sine.
    Asin,
    /// Inverse cosine.
    Acos,
    /// Inverse tangent.
    Atan,
    /// Exponential function.
    Exp,
    /// Natural logarithm.
    Ln,
}

impl Function {
    /// The functions by the names that scenes give them.
    pub const NAMES: &[(&str, Self)] = &[
        ("abs", Self::Abs),
        ("sqrt", Self::Sqrt),
        ("floor", Self::Floor),
        ("ceil", Self::Ceil),
        ("round", Self::Round),
        ("sin", Self::Sin),
        ("cos", Self::Cos),
        ("tan", Self::Tan),
        ("asin", Self::Asin),
        ("acos", Self::Acos),
        ("atan", Self::Atan),
        ("exp", Self::Exp),
        ("ln", Self::Ln),
    ];

    /// Its value.
    pub fn value(self, x: f64) -> f64 {
        match self {
            Self::Abs => x.abs(),
            Self::Sqrt => x.sqrt(),
            Self::Floor => x.floor(),
            Self::Ceil => x.ceil(),
            Self::Round => x.round(),
            Self::Sin => real::sin(x),
            Self::Cos => real::cos(x),
            Self::Tan => real::tan(x),
            Self::Asin => real::asin(x),
            Self::Acos => real::acos(x),
            Self::Atan => real::atan(x),
            Self::Exp => real::exp(x),
            Self::Ln => real::ln(x),
        }
    }
}

/// What joins two numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Operator {
    /// a + b
    Add,
    /// a - b
    Subtract,
    /// a b
    Multiply,
    /// a / b
    Divide,
    /// a to the power of b
    Power,
    /// The smaller.
    Minimum,
    /// The larger.
    Maximum,
}

impl Operator {
    /// Its value.
    pub fn value(self, a: f64, b: f64) -> f64 {
        match self {
            Self::Add => a + b,
            Self::Subtract => a - b,
            Self::Multiply => a * b,
            Self::Divide => a / b,
            Self::Power => real::powf(a, b),
            Self::Minimum => a.min(b),
            Self::Maximum => a.max(b),
        }
    }
}

/// One step of a formula, on a stack of numbers.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Operation {
    /// Puts a number on the stack.
    Number(f64),
    /// Puts the time on the stack, s.
    Time,
    /// Replaces the uppermost number by the function's value.
    Function(Function),
    /// Replaces the two uppermost numbers by one.
    Operator(Operator),
}

/// A scalar function of time: operations in postfix order that leave one number. Units are SI.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Formula(Vec<Operation>);

/// Relative accuracy of integrals of formulas.
const ACCURACY: f64 = 1e-12;

/// Halvings of an interval after which an integral is taken as it is: around a jump the error is then that of
/// 2^-30 of the step.
const HALVINGS: u32 = 30;

/// Intervals of one integral: what swings faster than they resolve is not integrated any better.
const INTERVALS: u32 = 2000;

/// What the shortest intervals still change, over the sum of the magnitudes of all: beyond this the integral
/// does not exist. (That of 1 / sqrt(t) does. That of 1 / t^0.9 does, too, but would take more halvings to
/// find.)
const DIVERGENT: f64 = 1e-3;

/// Gauss-Legendre points and weights on [-1, 1], five points, the positive half.
const GAUSS: [[f64; 2]; 3] = [
    [0.0, 128.0 / 225.0],
    [0.538_469_310_105_683_1, 0.478_628_670_499_366_47],
    [0.906_179_845_938_664, 0.236_926_885_056_189_08],
];

impl Formula {
    /// A formula of these operations.
    ///
    /// # Errors
    /// [`ModelError::Table`] where they take more numbers than there are or leave another count than one, and
    /// [`ModelError::Value`] for a number that is not finite.
    pub fn new(operations: Vec<Operation>) -> Result<Self, ModelError> {
        let formula = Self(operations);
        formula.validate()?;
        Ok(formula)
    }

    /// The operations, in postfix order.
    pub fn operations(&self) -> &[Operation] {
        &self.0
    }

    /// Checks what [`Formula::new`] does.
    pub(crate) fn validate(&self) -> Result<(), ModelError> {
        let broken = || ModelError::Table {
            what: "a formula does not take and leave its numbers in pairs".to_string(),
        };
        let mut height = 0_usize;
        for operation in &self.0 {
            let taken = match operation {
                Operation::Number(number) => {
                    crate::error::finite("a number in a formula", &[*number])?;
                    0
                }
                Operation::Time => 0,
                Operation::Function(_) => 1,
                Operation::Operator(_) => 2,
            };
            height = height.checked_sub(taken).ok_or_else(broken)? + 1;
        }
        if height == 1 { Ok(()) } else { Err(broken()) }
    }

    /// The value at a time, s.
    pub fn value(&self, time: f64) -> f64 {
        let mut stack: Vec<f64> = Vec::with_capacity(self.0.len());
        for operation in &self.0 {
            match *operation {
                Operation::Number(number) => stack.push(number),
                Operation::Time => stack.push(time),
                Operation::Function(function) => {
                    let x = stack.pop().unwrap_or(f64::NAN);
                    stack.push(function.value(x));
                }
                Operation::Operator(operator) => {
                    let b = stack.pop().unwrap_or(f64::NAN);
                    let a = stack.pop().unwrap_or(f64::NAN);
                    stack.push(operator.value(a, b));
                }
            }
        }
        stack.pop().unwrap_or(f64::NAN)
    }

    /// Integral over [start, start + step] by Gauss-Legendre quadrature on intervals that are halved until
    /// they agree to 1e-12 with their halves. Where the formula is not a number on more than single moments
    /// (sin(t) / t at 0 is one), neither is the integral, nor where it goes to infinity too fast to have one
    /// (1 / t at 0).
    pub fn integral(&self, start: f64, step: f64) -> f64 {
        // The least of three values: one of them may lie beside a pole.
        let least = [0.25, 0.5, 0.75].map(|x| self.value(start + x * step).abs()).into_iter();
        let slack = ACCURACY * step.abs() * least.fold(f64::INFINITY, f64::min);
        let slack = if slack.is_finite() { slack } else { 0.0 };
        let (mut sum, mut magnitude, mut unresolved, mut count) = (0.0, 0.0, 0.0, 0);
        let mut open = vec![(start, step, self.gauss(start, step), slack, 0)];
        while let Some((start, step, whole, slack, depth)) = open.pop() {
            let half = 0.5 * step;
            let parts = [self.gauss(start, half), self.gauss(start + half, half)];
            let refined = parts[0] + parts[1];
            count += 1;
            let close = (refined - whole).abs() <= ACCURACY * (parts[0].abs() + parts[1].abs()) + slack;
            if close || depth >= HALVINGS || count >= INTERVALS || !refined.is_finite() {
                sum += refined;
                magnitude += refined.abs();
                unresolved += if !close && depth >= HALVINGS { (refined - whole).abs() } else { 0.0 };
            } else {
                open.push((start + half, half, parts[1], 0.5 * slack, depth + 1));
                open.push((start, half, parts[0], 0.5 * slack, depth + 1));
            }
        }
        if unresolved > DIVERGENT * magnitude { f64::NAN } else { sum }
    }

    fn gauss(&self, start: f64, step: f64) -> f64 {
        let (middle, half) = (start + 0.5 * step, 0.5 * step);
        let [centre, rest @ ..] = GAUSS;
        let pairs =
            rest.map(|[x, weight]| weight * (self.value(middle - half * x) + self.value(middle + half * x)));
        half * (centre[1] * self.value(middle) + pairs.iter().sum::<f64>())
    }
}

#[cfg(test)]
mod tests {
    use super::Operation::{Function as F, Number, Operator as O, Time};
    use super::*;

    /// 2 sin(3 t) + max(t - 0.4, 0)
    fn bent() -> Formula {
        let operations = vec![
            Number(2.0),
            Number(3.0),
            Time,
            O(Operator::Multiply),
            F(Function::Sin),
            O(Operator::Multiply),
            Time,
            Number(0.4),
            O(Operator::Subtract),
            Number(0.0),
            O(Operator::Maximum),
            O(Operator::Add),
        ];
        Formula::new(operations).unwrap()
    }

    #[test]
    fn values_and_integrals_are_those_of_the_function() {
        let formula = bent();
        let value = |t: f64| 2.0 * (3.0 * t).sin() + (t - 0.4).max(0.0);
        let integral = |t: f64| -2.0 / 3.0 * (3.0 * t).cos() + 0.5 * (t - 0.4).max(0.0).powi(2);
        for (start, step) in [(0.0, 0.01), (0.35, 0.1), (0.0, 2.0), (0.399, 1e-3), (0.4, 1e-3)] {
            assert_eq!(formula.value(start), value(start));
            let expected = integral(start + step) - integral(start);
            let found = formula.integral(start, step);
            assert!((found - expected).abs() < 1e-12, "{start}: {found}, not {expected}");
        }
    }

    #[test]
    fn a_moment_without_a_value_is_passed_by() {
        let operations = vec![Time, F(Function::Sin), Time, O(Operator::Divide)];
        let formula = Formula::new(operations).unwrap();
        assert!(formula.value(0.0).is_nan());
        // Si(1), twice.
        assert!((formula.integral(-1.0, 2.0) - 2.0 * 0.946_083_070_367_183).abs() < 1e-11);
    }

    #[test]
    fn a_jump_costs_little_and_not_a_number_ends() {
        let jump = vec![Time, F(Function::Floor)];
        let found = Formula::new(jump).unwrap().integral(0.9, 0.3);
        assert!((found - 0.2).abs() < 1e-9, "{found}");
        let root = vec![Time, Number(-1.0), O(Operator::Multiply), F(Function::Sqrt)];
        assert!(Formula::new(root).unwrap().integral(1.0, 0.1).is_nan());
        for (power, exists) in [(0.5, true), (1.0, false), (2.0, false)] {
            let operations = vec![
                Number(1.0),
                Time,
                F(Function::Abs),
                Number(power),
                O(Operator::Power),
                O(Operator::Divide),
            ];
            let formula = Formula::new(operations).unwrap();
            assert_eq!(formula.integral(-1e-3, 2e-3).is_finite(), exists, "|t|^-{power}");
            assert_eq!(formula.integral(0.3e-3 - 1e-3, 1e-3).is_finite(), exists, "|t|^-{power}");
            assert_eq!(formula.integral(1e-19 - 0.5e-3, 1e-3).is_finite(), exists, "|t|^-{power}");
        }
    }

    #[test]
    fn operations_that_do_not_fit_are_refused() {
        for bad in
            [vec![], vec![O(Operator::Add)], vec![Time, Time], vec![Number(f64::NAN)], vec![F(Function::Sin)]]
        {
            assert!(Formula::new(bad.clone()).is_err(), "{bad:?}");
        }
    }
}
