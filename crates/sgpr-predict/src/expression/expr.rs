use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

use super::tape::{Expr, Node, looked_up, recorded};
use crate::simd::{Number, Real};

impl Expr {
    /// An input, by its number.
    #[doc(hidden)]
    pub fn input(index: usize) -> Self {
        recorded(Node::Input(index))
    }

    /// Place on the tape.
    #[doc(hidden)]
    pub fn index(self) -> usize {
        self.0 as usize
    }

    fn value(self) -> Option<f64> {
        match looked_up(self) {
            Node::Constant(value) => Some(value),
            _ => None,
        }
    }

    /// What is negated, if the expression is a negation.
    fn negated(self) -> Option<Self> {
        match looked_up(self) {
            Node::Neg(inner) => Some(inner),
            _ => None,
        }
    }

    fn of_one(self, on_number: impl Fn(f64) -> f64, node: impl Fn(Self) -> Node) -> Self {
        self.value().map_or_else(|| recorded(node(self)), |value| Self::constant(on_number(value)))
    }
}

impl Neg for Expr {
    type Output = Self;

    fn neg(self) -> Self {
        match looked_up(self) {
            Node::Constant(value) => Self::constant(-value),
            Node::Neg(inner) => inner,
            Node::Sub(a, b) => b - a,
            _ => recorded(Node::Neg(self)),
        }
    }
}

impl Add for Expr {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        match (self.value(), other.value()) {
            (Some(a), Some(b)) => return Self::constant(a + b),
            (Some(a), _) if a.is_infinite() => return self,
            (_, Some(b)) if b.is_infinite() => return other,
            (Some(0.0), _) => return other,
            (_, Some(0.0)) => return self,
            _ => {}
        }
        match (self.negated(), other.negated()) {
            (Some(a), Some(b)) => -(a + b),
            (Some(a), None) => other - a,
            (None, Some(b)) => self - b,
            (None, None) => recorded(Node::Add(Ord::min(self, other), Ord::max(self, other))),
        }
    }
}

impl Sub for Expr {
    type Output = Self;

    fn sub(self, other: Self) -> Self {
        match (self.value(), other.value()) {
            (Some(a), Some(b)) => return Self::constant(a - b),
            (Some(a), _) if a.is_infinite() => return self,
            (_, Some(b)) if b.is_infinite() => return -other,
            (Some(0.0), _) => return -other,
            (_, Some(0.0)) => return self,
            _ if self == other => return Self::constant(0.0),
            _ => {}
        }
        match (self.negated(), other.negated()) {
            (Some(a), Some(b)) => b - a,
            (Some(a), None) => -(a + other),
            (None, Some(b)) => self + b,
            (None, None) => recorded(Node::Sub(self, other)),
        }
    }
}

impl Mul for Expr {
    type Output = Self;

    fn mul(self, other: Self) -> Self {
        let (a, b) = match (self.value(), other.value()) {
            (Some(a), Some(b)) => return Self::constant(a * b),
            (Some(a), None) => (a, other),
            (None, Some(b)) => (b, self),
            (None, None) => {
                return match (self.negated(), other.negated()) {
                    (Some(a), Some(b)) => a * b,
                    (Some(a), None) => -(a * other),
                    (None, Some(b)) => -(self * b),
                    (None, None) => {
                        recorded(Node::Mul(Ord::min(self, other), Ord::max(self, other)))
                    }
                };
            }
        };
        // A constant times an expression: the constant is positive, and there is one.
        match (a, looked_up(b)) {
            (0.0, _) => Self::constant(0.0),
            (1.0, _) => b,
            (-1.0, _) => -b,
            (_, Node::Neg(inner)) => inner * Self::constant(-a),
            (_, Node::Mul(factor, inner)) if factor.value().is_some() => {
                inner * (factor * Self::constant(a))
            }
            _ if a < 0.0 => -(b * Self::constant(-a)),
            _ => recorded(Node::Mul(Self::constant(a), b)),
        }
    }
}

impl Div for Expr {
    type Output = Self;

    fn div(self, other: Self) -> Self {
        match (self.value(), other.value()) {
            (Some(a), Some(b)) => Self::constant(a / b),
            (_, Some(1.0)) => self,
            (Some(0.0), _) => self,
            _ => recorded(Node::Div(self, other)),
        }
    }
}

impl AddAssign for Expr {
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl SubAssign for Expr {
    fn sub_assign(&mut self, other: Self) {
        *self = *self - other;
    }
}

impl Add<f64> for Expr {
    type Output = Self;

    fn add(self, other: f64) -> Self {
        self + Self::constant(other)
    }
}

impl Sub<f64> for Expr {
    type Output = Self;

    fn sub(self, other: f64) -> Self {
        self - Self::constant(other)
    }
}

impl Mul<f64> for Expr {
    type Output = Self;

    fn mul(self, other: f64) -> Self {
        self * Self::constant(other)
    }
}

impl Div<f64> for Expr {
    type Output = Self;

    fn div(self, other: f64) -> Self {
        self / Self::constant(other)
    }
}

impl Real for Expr {
    type Token = ();
    type Constant = f64;

    #[inline(always)]
    fn rounded(value: f64) -> f64 {
        value
    }

    fn splat((): (), value: f64) -> Self {
        // One zero is enough.
        recorded(Node::Constant(if value == 0.0 { 0.0 } else { value }))
    }

    fn mul_add(self, b: Self, c: Self) -> Self {
        self * b + c
    }

    fn recip(self) -> Self {
        Self::constant(1.0) / self
    }
}

impl Number for Expr {
    fn sqrt(self) -> Self {
        self.of_one(f64::sqrt, Node::Sqrt)
    }

    fn exp(self) -> Self {
        self.of_one(f64::exp, Node::Exp)
    }

    fn tanh(self) -> Self {
        self.of_one(f64::tanh, Node::Tanh)
    }

    fn abs(self) -> Self {
        match looked_up(self) {
            Node::Neg(inner) => inner.abs(),
            Node::Abs(_) => self,
            _ => self.of_one(f64::abs, Node::Abs),
        }
    }

    fn sgn(self) -> Self {
        match looked_up(self) {
            Node::Neg(inner) => -inner.sgn(),
            _ => self.of_one(Number::sgn, Node::Sgn),
        }
    }

    fn sin_cos(self) -> (Self, Self) {
        match looked_up(self) {
            Node::Neg(inner) => {
                let (sine, cosine) = inner.sin_cos();
                (-sine, cosine)
            }
            _ => (self.of_one(f64::sin, Node::Sin), self.of_one(f64::cos, Node::Cos)),
        }
    }

    fn powf(self, exponent: f64) -> Self {
        self.of_one(|value| value.powf(exponent), |inner| Node::Power(inner, exponent))
    }

    fn where_positive(self, yes: Self, no: Self) -> Self {
        match self.value() {
            _ if yes == no => yes,
            Some(value) => {
                if value > 0.0 {
                    yes
                } else {
                    no
                }
            }
            None => recorded(Node::Select(self, yes, no)),
        }
    }

    fn clamp(self, low: Self, high: Self) -> Self {
        match (self.value(), low.value(), high.value()) {
            (Some(value), Some(low), Some(high)) => Self::constant(value.clamp(low, high)),
            _ => recorded(Node::Clamp(self, low, high)),
        }
    }

    fn is_surely_zero(self) -> bool {
        self.value() == Some(0.0)
    }

    fn is_known(self) -> bool {
        self.value().is_none_or(|value| !value.is_nan())
    }
}
