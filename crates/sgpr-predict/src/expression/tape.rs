#![allow(missing_docs, reason = "hidden: for those who print formulas")]

use std::cell::RefCell;
use std::collections::HashMap;

/// A number of which only the formula is known. Finite, unless it is a constant.
///
/// Belongs to the tape that the thread records; without one it cannot be computed with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Expr(pub(super) u32);

/// One operation of a tape; operands come before it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Node {
    /// A number.
    Constant(f64),
    /// An input, by its number.
    Input(usize),
    Add(Expr, Expr),
    Sub(Expr, Expr),
    Mul(Expr, Expr),
    Div(Expr, Expr),
    Neg(Expr),
    Sin(Expr),
    Cos(Expr),
    Exp(Expr),
    Tanh(Expr),
    Sqrt(Expr),
    Abs(Expr),
    /// Sign, zero at zero.
    Sgn(Expr),
    /// To a constant power.
    Power(Expr, f64),
    /// The second where the first is above zero, else the third.
    Select(Expr, Expr, Expr),
    /// The first, not below the second and not above the third.
    Clamp(Expr, Expr, Expr),
}

impl Node {
    /// What the operation works on.
    pub fn operands(&self) -> impl Iterator<Item = Expr> {
        let [a, b, c] = match *self {
            Self::Constant(_) | Self::Input(_) => [None; 3],
            Self::Add(a, b) | Self::Sub(a, b) | Self::Mul(a, b) | Self::Div(a, b) => {
                [Some(a), Some(b), None]
            }
            Self::Select(a, b, c) | Self::Clamp(a, b, c) => [Some(a), Some(b), Some(c)],
            Self::Neg(a) | Self::Sin(a) | Self::Cos(a) | Self::Exp(a) | Self::Tanh(a) => {
                [Some(a), None, None]
            }
            Self::Sqrt(a) | Self::Abs(a) | Self::Sgn(a) | Self::Power(a, _) => {
                [Some(a), None, None]
            }
        };
        [a, b, c].into_iter().flatten()
    }

    /// The same for the same operation; two numbers are the same if their bits are.
    fn key(&self) -> (u8, u64, u64, u64) {
        let of = |kind: u8, a: Expr| (kind, u64::from(a.0), 0, 0);
        let of_two = |kind: u8, a: Expr, b: Expr| (kind, u64::from(a.0), u64::from(b.0), 0);
        let of_three = |kind: u8, a: Expr, b: Expr, c: Expr| {
            (kind, u64::from(a.0), u64::from(b.0), u64::from(c.0))
        };
        match *self {
            Self::Constant(value) => (0, value.to_bits(), 0, 0),
            Self::Input(index) => (1, index as u64, 0, 0),
            Self::Add(a, b) => of_two(2, a, b),
            Self::Sub(a, b) => of_two(3, a, b),
            Self::Mul(a, b) => of_two(4, a, b),
            Self::Div(a, b) => of_two(5, a, b),
            Self::Neg(a) => of(6, a),
            Self::Sin(a) => of(7, a),
            Self::Cos(a) => of(8, a),
            Self::Exp(a) => of(9, a),
            Self::Tanh(a) => of(10, a),
            Self::Sqrt(a) => of(11, a),
            Self::Abs(a) => of(12, a),
            Self::Sgn(a) => of(13, a),
            Self::Power(a, exponent) => (14, u64::from(a.0), exponent.to_bits(), 0),
            Self::Select(a, b, c) => of_three(15, a, b, c),
            Self::Clamp(a, b, c) => of_three(16, a, b, c),
        }
    }
}

/// Operations in an order in which they can be done, each once.
#[derive(Debug, Default)]
pub struct Tape {
    nodes: Vec<Node>,
    known: HashMap<(u8, u64, u64, u64), Expr>,
}

impl Tape {
    /// The operation behind an expression.
    pub fn node(&self, expr: Expr) -> Node {
        self.nodes[expr.0 as usize]
    }

    /// The operation at a place.
    pub fn at(&self, index: usize) -> Node {
        self.nodes[index]
    }

    /// The input behind an operation, if it is one.
    pub fn input(&self, index: usize) -> Option<usize> {
        match self.nodes[index] {
            Node::Input(input) => Some(input),
            _ => None,
        }
    }

    /// Whether there is no operation.
    pub fn is_empty(&self) -> bool {
        self.nodes.is_empty()
    }

    /// Number of operations.
    pub fn len(&self) -> usize {
        self.nodes.len()
    }

    /// How often each operation is used by those that the outputs need, and by the outputs
    /// themselves; zero for others.
    pub fn uses(&self, outputs: &[Expr]) -> Vec<usize> {
        let mut uses = vec![0; self.nodes.len()];
        outputs.iter().for_each(|output| uses[output.0 as usize] += 1);
        for index in (0..self.nodes.len()).rev() {
            if uses[index] > 0 {
                self.nodes[index].operands().for_each(|operand| uses[operand.0 as usize] += 1);
            }
        }
        uses
    }

    fn push(&mut self, node: Node) -> Expr {
        let next =
            Expr(u32::try_from(self.nodes.len()).expect("a tape of fewer than 2^32 operations"));
        let nodes = &mut self.nodes;
        *self.known.entry(node.key()).or_insert_with(|| {
            nodes.push(node);
            next
        })
    }
}

thread_local! {
    static TAPE: RefCell<Option<Tape>> = const { RefCell::new(None) };
}

/// The tape of this thread, from its beginning to [`Self::finish`].
#[derive(Debug)]
pub struct Recorder(());

impl Recorder {
    /// Begins an empty tape.
    pub fn start() -> Self {
        TAPE.set(Some(Tape::default()));
        Self(())
    }

    /// What was recorded.
    pub fn finish(self) -> Tape {
        TAPE.take().expect("begun by this recorder")
    }
}

impl Drop for Recorder {
    fn drop(&mut self) {
        TAPE.set(None);
    }
}

/// The expression of an operation; recorded if it is new.
pub(super) fn recorded(node: Node) -> Expr {
    TAPE.with_borrow_mut(|tape| {
        tape.as_mut().expect("expressions live while their tape is recorded").push(node)
    })
}

/// The operation behind an expression.
pub(super) fn looked_up(expr: Expr) -> Node {
    TAPE.with_borrow(|tape| {
        tape.as_ref().expect("expressions live while their tape is recorded").node(expr)
    })
}
