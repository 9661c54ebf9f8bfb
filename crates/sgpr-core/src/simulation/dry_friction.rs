//! Which joints slide and which stick: the torque balance with bounded friction.

/// How a joint stands to its dry friction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Contact {
    /// No dry friction: any velocity, no bounded torque.
    Free,
    /// Slides forwards.
    Forwards,
    /// Slides backwards.
    Backwards,
    /// Held.
    Stuck,
}

/// A x + f = b with |f| bounded, f opposing x: x > 0 with f = upper, x < 0 with f = -lower, or x =
/// 0 with f between.
///
/// A is symmetric positive definite, so there is exactly one solution: the minimum of xᵀA x / 2 -
/// bᵀx + sum(upper max(x, 0) + lower max(-x, 0)). Whether each joint slides or sticks is guessed
/// from the step before; one Cholesky factor of the sliding joints then proves the guess or says
/// what to change. All wrong joints are changed at once while that helps, then one at a time, which
/// ends for any such A.
///
/// Source: J. J. Júdice, F. M. Pires, A block principal pivoting algorithm for large-scale strictly
/// monotone linear complementarity problems, Computers & Operations Research 21(5) (1994).
#[derive(Clone, Debug)]
pub(super) struct DryFriction {
    n: usize,
    /// A, row-major, lower triangle.
    pub a: Vec<f64>,
    pub b: Vec<f64>,
    /// Largest friction against motion forwards (0) and backwards (1).
    pub bound: Vec<[f64; 2]>,
    pub contact: Vec<Contact>,
    /// Joints whose contact is known and stays.
    pub known: Vec<bool>,
    pub x: Vec<f64>,
    /// Friction torque in the units of b.
    pub friction: Vec<f64>,
    factor: Vec<f64>,
}

/// The matrix is not positive definite at this row.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct NotPositive(pub usize);

impl DryFriction {
    pub fn new(n: usize) -> Self {
        Self {
            n,
            a: vec![0.0; n * n],
            b: vec![0.0; n],
            bound: vec![[0.0; 2]; n],
            contact: vec![Contact::Stuck; n],
            known: vec![false; n],
            x: vec![0.0; n],
            friction: vec![0.0; n],
            factor: vec![0.0; n * n],
        }
    }

    /// Sets `x`, `friction` and `contact`.
    pub fn solve(&mut self) -> Result<(), NotPositive> {
        let mut fewest = usize::MAX;
        let mut patience = 3;
        // Each of 3^n patterns at most once; in practice one or two.
        for _ in 0..1000 {
            self.solve_pattern()?;
            let wrong = (0..self.n).filter(|&joint| self.correction(joint).is_some()).count();
            if wrong == 0 {
                return Ok(());
            }
            if wrong < fewest {
                (fewest, patience) = (wrong, 3);
            } else if patience > 0 {
                patience -= 1;
            }
            for joint in (0..self.n).rev() {
                if let Some(contact) = self.correction(joint) {
                    self.contact[joint] = contact;
                    if patience == 0 {
                        break;
                    }
                }
            }
        }
        Ok(())
    }

    /// What the contact of a joint has to become.
    #[inline]
    fn correction(&self, joint: usize) -> Option<Contact> {
        if self.known[joint] {
            return None;
        }
        let (x, f, [upper, lower]) = (self.x[joint], self.friction[joint], self.bound[joint]);
        match self.contact[joint] {
            Contact::Forwards if x < 0.0 => Some(Contact::Stuck),
            Contact::Backwards if x > 0.0 => Some(Contact::Stuck),
            Contact::Stuck if f > upper => Some(Contact::Forwards),
            Contact::Stuck if f < -lower => Some(Contact::Backwards),
            _ => None,
        }
    }

    /// Solution if every joint does what `contact` says.
    pub fn solve_pattern(&mut self) -> Result<(), NotPositive> {
        let n = self.n;
        let Self { a, b, bound, contact, x, friction, factor, .. } = self;
        // Right-hand side, held joints taken out.
        for i in 0..n {
            friction[i] = match contact[i] {
                Contact::Forwards => bound[i][0],
                Contact::Backwards => -bound[i][1],
                Contact::Free | Contact::Stuck => 0.0,
            };
            x[i] = if contact[i] == Contact::Stuck { 0.0 } else { b[i] - friction[i] };
        }
        // L D Lᵀ of the rows that move; `factor` holds L, and 1 / D on its diagonal.
        for i in 0..n {
            if contact[i] == Contact::Stuck {
                factor[i * n..i * n + i].fill(0.0);
                factor[i * n + i] = 1.0;
                continue;
            }
            let (before, rest) = factor.split_at_mut(i * n);
            let row = &mut rest[..i + 1];
            let mut pivot = a[i * n + i];
            let mut value = x[i];
            for j in 0..i {
                if contact[j] == Contact::Stuck {
                    row[j] = 0.0;
                    continue;
                }
                let other = &before[j * n..j * n + j + 1];
                let mut sum = a[i * n + j];
                for k in 0..j {
                    sum -= row[k] * other[k];
                }
                row[j] = sum;
            }
            for j in 0..i {
                let scaled = row[j] * before[j * n + j];
                pivot -= row[j] * scaled;
                row[j] = scaled;
                value -= scaled * x[j];
            }
            if pivot.is_nan() || pivot <= 1e-14 * a[i * n + i] {
                return Err(NotPositive(i));
            }
            row[i] = 1.0 / pivot;
            x[i] = value;
        }
        for i in (0..n).rev() {
            let mut value = x[i] * factor[i * n + i];
            for k in i + 1..n {
                value -= factor[k * n + i] * x[k];
            }
            x[i] = if contact[i] == Contact::Stuck { 0.0 } else { value };
        }
        for i in 0..n {
            if contact[i] == Contact::Stuck {
                let mut value = b[i];
                for k in 0..n {
                    value -= if k <= i { a[i * n + k] } else { a[k * n + i] } * x[k];
                }
                friction[i] = value;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::{Rng, SeedableRng};

    use super::*;

    fn uniform(random: &mut ChaCha8Rng) -> f64 {
        (random.next_u64() >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    /// Projected Gauss-Seidel on the same problem, a method that shares nothing but the definition.
    fn gauss_seidel(problem: &DryFriction) -> Vec<f64> {
        let n = problem.n;
        let entry = |i: usize, j: usize| problem.a[i.max(j) * n + i.min(j)];
        let mut x = vec![0.0; n];
        for _ in 0..200_000 {
            let mut change = 0.0f64;
            for i in 0..n {
                let rest = problem.b[i]
                    - (0..n).filter(|j| *j != i).map(|j| entry(i, j) * x[j]).sum::<f64>();
                let [upper, lower] = problem.bound[i];
                let next =
                    if rest > upper { rest - upper } else { (rest + lower).min(0.0) } / entry(i, i);
                change = change.max((next - x[i]).abs());
                x[i] = next;
            }
            if change < 1e-15 {
                break;
            }
        }
        x
    }

    #[test]
    fn agrees_with_projected_gauss_seidel_from_any_guess() {
        let mut random = ChaCha8Rng::seed_from_u64(3);
        for case in 0..300 {
            let n = 1 + case % 7;
            let mut problem = DryFriction::new(n);
            let root: Vec<f64> = (0..n * n).map(|_| uniform(&mut random)).collect();
            for i in 0..n {
                for j in 0..n {
                    let product: f64 = (0..n).map(|k| root[i * n + k] * root[j * n + k]).sum();
                    problem.a[i * n + j] = product + if i == j { 0.2 } else { 0.0 };
                }
                problem.b[i] = 3.0 * uniform(&mut random);
                problem.bound[i] = [1.0 + uniform(&mut random), 1.0 + uniform(&mut random)];
                problem.contact[i] = [Contact::Forwards, Contact::Backwards, Contact::Stuck]
                    [random.next_u32() as usize % 3];
            }
            problem.solve().expect("positive definite");
            let expected = gauss_seidel(&problem);
            for i in 0..n {
                assert!(
                    (problem.x[i] - expected[i]).abs() < 1e-9,
                    "case {case}: {:?} {expected:?}",
                    problem.x
                );
            }
        }
    }

    #[test]
    fn a_matrix_without_inertia_is_named() {
        let mut problem = DryFriction::new(2);
        problem.a = vec![1.0, 0.0, 0.0, 0.0];
        problem.contact = vec![Contact::Free; 2];
        assert_eq!(problem.solve(), Err(NotPositive(1)));
    }
}
