//! A kernel laid out for arithmetic on tiles of points: the tree flattened, inputs scaled once and
//! stored by columns.

use alloc::vec::Vec;
use core::f64::consts::TAU;
use core::ops::Range;

use super::{Element, Kernel, Points, REGISTERS, Shape, TILE};
#[cfg(not(feature = "std"))]
use crate::math::Float;
use crate::simd::{Arch, Simd, WithSimd};

/// A kernel ready to be evaluated.
#[derive(Clone, Debug)]
pub struct Plan {
    /// Children before parents; the last one is the kernel.
    nodes: Vec<KernelNode>,
    leaves: Vec<Leaf>,
    columns: Vec<Coordinate>,
    theta_len: usize,
    variance: f64,
}

#[derive(Clone, Debug)]
enum KernelNode {
    Leaf(usize),
    Scaled { variance: f64, theta: usize, child: usize },
    Sum(Vec<usize>),
    Product(Vec<usize>),
}

#[derive(Clone, Debug)]
struct Leaf {
    shape: Shape,
    /// Its columns among those of the plan.
    columns: Range<usize>,
    /// Index of the one length scale, if there is only one.
    single: Option<usize>,
    /// Index of the mixture of a rational quadratic.
    mixture: Option<usize>,
}

/// A coordinate of the space in which distances are Euclidean.
#[derive(Clone, Debug)]
struct Coordinate {
    input: usize,
    /// Of an input on a circle: (2 pi / period, phase), so that the coordinate is a cosine or sine.
    wave: Option<(f64, f64)>,
    /// One over the length scale, or the radius over it.
    factor: f64,
    /// Index of its length scale.
    theta: usize,
    /// Subtracted before scaling, so that single precision keeps its digits for differences.
    centre: f64,
}

impl Coordinate {
    fn coordinate(&self, x: &[f64]) -> f64 {
        let x = x[self.input];
        match self.wave {
            None => (x - self.centre) * self.factor,
            Some((frequency, phase)) => (frequency * x + phase).cos() * self.factor,
        }
    }

    fn slope(&self, x: &[f64]) -> f64 {
        match self.wave {
            None => self.factor,
            Some((frequency, phase)) => {
                -frequency * (frequency * x[self.input] + phase).sin() * self.factor
            }
        }
    }
}

/// Points in the coordinates of a plan, a column after the other, each `stride` long, padded with
/// zeros.
#[derive(Clone, Debug)]
pub struct Features<T> {
    values: Vec<T>,
    stride: usize,
    count: usize,
    /// First column of each leaf.
    leaves: Vec<usize>,
}

/// One point in the coordinates of a plan.
#[derive(Clone, Debug)]
pub struct Query<T>(Vec<T>);

/// Tiles that an evaluation writes.
#[derive(Clone, Debug)]
pub struct Work<T> {
    values: Vec<T>,
    adjoints: Vec<T>,
    squares: Vec<T>,
    slopes: Vec<T>,
    products: Vec<T>,
}

/// Points are padded to a multiple of this, the lanes of the widest register.
const PADDING: usize = 16;

impl<T: Element> Features<T> {
    /// Number of points.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Tiles (start, length) that cover the points from `first` on; lengths are padded.
    pub fn tiles_from(&self, first: usize) -> impl Iterator<Item = (usize, usize)> + use<T> {
        let (start, end) = (first / PADDING * PADDING, self.count.next_multiple_of(PADDING));
        (start..end).step_by(TILE).map(move |start| (start, TILE.min(end - start)))
    }

    /// The points `first..first + count`, each on its own.
    pub fn queries(&self, plan: &Plan, first: usize, count: usize) -> Vec<Query<T>> {
        let query = |index: usize| {
            let mut query = plan.query();
            self.point(index, &mut query);
            query
        };
        (first..first + count).map(query).collect()
    }

    /// One coordinate of all points.
    pub fn column(&self, column: usize) -> &[T] {
        &self.values[column * self.stride..][..self.count]
    }

    /// Copies a point.
    #[inline(always)]
    pub fn point(&self, index: usize, query: &mut Query<T>) {
        for (c, value) in query.0.iter_mut().enumerate() {
            *value = self.values[c * self.stride + index];
        }
    }
}

impl<T: Element> Points<T> for Features<T> {
    #[inline(always)]
    fn squares_at<S: Simd>(
        &self,
        simd: S,
        leaf: usize,
        start: usize,
        c: &[T],
    ) -> [T::Register<S>; REGISTERS] {
        T::squares_at(simd, &self.values[self.leaves[leaf] * self.stride..], self.stride, start, c)
    }

    /// For single registers, too.
    #[inline(always)]
    fn squared_distances<S: Simd>(
        &self,
        simd: S,
        leaf: usize,
        start: usize,
        c: &[T],
        squares: &mut [T],
    ) {
        T::squared_distances(
            simd,
            &self.values[self.leaves[leaf] * self.stride + start..],
            self.stride,
            c,
            squares,
        );
    }
}

impl<T> Query<T> {
    /// Some of its coordinates.
    pub fn coordinates(&self, columns: &Range<usize>) -> &[T] {
        &self.0[columns.clone()]
    }
}

impl Plan {
    /// Lays a kernel out.
    pub fn new(kernel: &Kernel) -> Self {
        let mut plan = Self {
            nodes: vec![],
            leaves: vec![],
            columns: vec![],
            theta_len: 0,
            variance: kernel.variance(),
        };
        plan.add(kernel);
        plan
    }

    /// Subtracts `centre` (one number per input) from points before they are scaled.
    #[must_use]
    pub fn centred(mut self, centre: &[f64]) -> Self {
        self.columns.iter_mut().for_each(|column| column.centre = centre[column.input]);
        self
    }

    /// Input and factor of every coordinate; none if an input is periodic.
    pub fn straight_columns(&self) -> Option<Vec<(usize, f64)>> {
        self.columns
            .iter()
            .map(|column| column.wave.is_none().then_some((column.input, column.factor)))
            .collect()
    }

    /// The coordinates of each leaf.
    pub fn leaf_columns(&self) -> impl Iterator<Item = Range<usize>> {
        self.leaves.iter().map(|leaf| leaf.columns.clone())
    }

    /// The only leaf, if there is no other: the kernel is then k(x, x) times its shape.
    pub fn single_leaf(&self) -> Option<(Shape, Range<usize>)> {
        match &self.leaves[..] {
            [leaf] => Some((leaf.shape, leaf.columns.clone())),
            _ => None,
        }
    }

    /// k(x, x).
    pub fn variance(&self) -> f64 {
        self.variance
    }

    /// Index of the variance that multiplies the whole kernel, if there is one.
    pub fn scale(&self) -> Option<usize> {
        match self.nodes.last() {
            Some(KernelNode::Scaled { theta, .. }) => Some(*theta),
            _ => None,
        }
    }

    /// Number of hyperparameters.
    pub fn theta_len(&self) -> usize {
        self.theta_len
    }

    fn next_theta(&mut self) -> usize {
        self.theta_len += 1;
        self.theta_len - 1
    }

    /// Numbers the hyperparameters in the order of [`Kernel::theta`].
    fn add(&mut self, kernel: &Kernel) -> usize {
        let node = match kernel {
            Kernel::Stationary(stationary) => {
                let first = self.columns.len();
                let single = (stationary.length_scales.len() == 1).then(|| self.next_theta());
                for (k, input) in stationary.inputs.iter().enumerate() {
                    let theta = single.unwrap_or_else(|| self.next_theta());
                    let column = |wave, size: f64| Coordinate {
                        input: input.index,
                        wave,
                        factor: size / stationary.scale(k),
                        theta,
                        centre: 0.0,
                    };
                    match input.period {
                        None => self.columns.push(column(None, 1.0)),
                        Some(period) => {
                            let frequency = TAU / period;
                            for phase in [0.0, -core::f64::consts::FRAC_PI_2] {
                                self.columns
                                    .push(column(Some((frequency, phase)), 1.0 / frequency));
                            }
                        }
                    }
                }
                let shape = stationary.shape;
                let mixture =
                    matches!(shape, Shape::RationalQuadratic { .. }).then(|| self.next_theta());
                self.leaves.push(Leaf {
                    shape,
                    columns: first..self.columns.len(),
                    single,
                    mixture,
                });
                KernelNode::Leaf(self.leaves.len() - 1)
            }
            Kernel::Scaled { variance, kernel } => {
                let theta = self.next_theta();
                KernelNode::Scaled { variance: *variance, theta, child: self.add(kernel) }
            }
            Kernel::Sum(parts) => {
                KernelNode::Sum(parts.iter().map(|part| self.add(part)).collect())
            }
            Kernel::Product(parts) => {
                KernelNode::Product(parts.iter().map(|part| self.add(part)).collect())
            }
        };
        self.nodes.push(node);
        self.nodes.len() - 1
    }

    /// The points of `x`, `[samples, inputs]` row-major, in the coordinates of the plan.
    pub fn features<T: Element>(&self, x: &[f64], inputs: usize) -> Features<T> {
        let count = x.len() / inputs;
        // One more line of the cache than a power of two, so that columns do not fall on each other
        // there.
        let stride = count.next_multiple_of(PADDING) + PADDING;
        let mut values = vec![T::default(); stride * self.columns.len()];
        for (column, out) in self.columns.iter().zip(values.chunks_exact_mut(stride)) {
            for (point, out) in x.chunks_exact(inputs).zip(out) {
                *out = T::from_f64(column.coordinate(point));
            }
        }
        Features {
            values,
            stride,
            count,
            leaves: self.leaves.iter().map(|leaf| leaf.columns.start).collect(),
        }
    }

    /// k(X, X) of the points of `x`, `[samples, inputs]` row-major, `[samples, samples]`.
    pub(crate) fn covariances(&self, x: &[f64], inputs: usize) -> Vec<f64> {
        Arch::new().dispatch(Covariances { plan: self, points: self.features(x, inputs) })
    }

    /// Room for a point.
    pub fn query<T: Element>(&self) -> Query<T> {
        Query(vec![T::default(); self.columns.len()])
    }

    /// Writes the point `x` into `query`.
    #[inline]
    pub fn set_query<T: Element>(&self, x: &[f64], query: &mut Query<T>) {
        for (column, value) in self.columns.iter().zip(&mut query.0) {
            *value = T::from_f64(column.coordinate(x));
        }
    }

    /// Room for what an evaluation writes.
    pub fn work<T: Element>(&self) -> Work<T> {
        let tiles = |count: usize| vec![T::default(); count * TILE];
        Work {
            values: tiles(self.nodes.len()),
            adjoints: tiles(self.nodes.len()),
            squares: tiles(self.leaves.len()),
            slopes: tiles(self.leaves.len()),
            products: tiles(1),
        }
    }

    /// k(query, points start..start + length); with slopes, what [`Plan::gradient`] needs stays in
    /// `work`.
    #[inline(always)]
    pub fn values<'w, T: Element, S: Simd, const SLOPES: bool>(
        &self,
        simd: S,
        points: &impl Points<T>,
        (start, length): (usize, usize),
        query: &Query<T>,
        work: &'w mut Work<T>,
    ) -> &'w [T] {
        for (index, node) in self.nodes.iter().enumerate() {
            let (before, rest) = work.values.split_at_mut(index * TILE);
            let out = &mut rest[..length];
            let child = |child: usize| &before[child * TILE..][..length];
            match node {
                KernelNode::Leaf(leaf) => {
                    let tile = leaf * TILE..leaf * TILE + length;
                    let Leaf { shape, columns, .. } = &self.leaves[*leaf];
                    let squares = &mut work.squares[tile.clone()];
                    let c = query.coordinates(columns);
                    points.squared_distances(simd, *leaf, start, c, squares);
                    T::shape::<S, SLOPES>(simd, *shape, squares, out, &mut work.slopes[tile]);
                }
                KernelNode::Scaled { variance, child: index, .. } => {
                    let variance = T::from_f64(*variance);
                    T::scale(variance, child(*index), out);
                }
                KernelNode::Sum(children) => {
                    out.copy_from_slice(child(children[0]));
                    children[1..].iter().for_each(|index| T::add_to(child(*index), out));
                }
                KernelNode::Product(children) => {
                    out.copy_from_slice(child(children[0]));
                    children[1..].iter().for_each(|index| T::multiply_to(child(*index), out));
                }
            }
        }
        &work.values[(self.nodes.len() - 1) * TILE..][..length]
    }

    /// Adds sum over points of weight * dk(query, point) / dtheta, right after [`Plan::values`] of
    /// the same tile.
    ///
    /// With `location`, adds sum of weight * dk / dcoordinate of the query as well.
    #[inline(always)]
    pub fn gradient<T: Element, S: Simd>(
        &self,
        simd: S,
        (points, start, length): (&Features<T>, usize, usize),
        query: &Query<T>,
        weights: &[T],
        work: &mut Work<T>,
        (gradient, mut location): (&mut [f64], Option<&mut [f64]>),
    ) {
        let root = self.nodes.len() - 1;
        work.adjoints[root * TILE..][..length].copy_from_slice(weights);
        for (index, node) in self.nodes.iter().enumerate().rev() {
            let (before, rest) = work.adjoints.split_at_mut(index * TILE);
            let adjoint = &rest[..length];
            match node {
                KernelNode::Leaf(leaf) => {
                    let tile = leaf * TILE..leaf * TILE + length;
                    let Leaf { shape, columns, single, mixture } = &self.leaves[*leaf];
                    let squares = &work.squares[tile.clone()];
                    let slopes = &mut work.slopes[tile];
                    T::multiply_to(adjoint, slopes);
                    if let Some(theta) = single {
                        gradient[*theta] -= 2.0 * T::dot(simd, slopes, squares);
                    }
                    for c in columns.clone() {
                        let x = &points.values[c * points.stride + start..][..length];
                        if single.is_none() {
                            gradient[self.columns[c].theta] -=
                                2.0 * T::weighted_squares(simd, slopes, x, query.0[c]);
                        }
                        if let Some(location) = &mut location {
                            location[c] -=
                                2.0 * T::weighted_differences(simd, slopes, x, query.0[c]);
                        }
                    }
                    if let (Some(theta), Shape::RationalQuadratic { mixture }) = (mixture, shape) {
                        let values = &work.values[index * TILE..][..length];
                        for ((adjoint, k), r2) in adjoint.iter().zip(values).zip(squares) {
                            let u = r2.to_f64() / (2.0 * mixture);
                            let slope = mixture * (u / (1.0 + u) - u.ln_1p());
                            gradient[*theta] += adjoint.to_f64() * k.to_f64() * slope;
                        }
                    }
                }
                KernelNode::Scaled { variance, theta, child } => {
                    gradient[*theta] +=
                        T::dot(simd, adjoint, &work.values[index * TILE..][..length]);
                    T::scale(
                        T::from_f64(*variance),
                        adjoint,
                        &mut before[child * TILE..][..length],
                    );
                }
                KernelNode::Sum(children) => {
                    for child in children {
                        before[child * TILE..][..length].copy_from_slice(adjoint);
                    }
                }
                KernelNode::Product(children) => {
                    for child in children {
                        let product = &mut work.products[..length];
                        product.copy_from_slice(adjoint);
                        for other in children.iter().filter(|other| *other != child) {
                            T::multiply_to(&work.values[other * TILE..][..length], product);
                        }
                        before[child * TILE..][..length].copy_from_slice(product);
                    }
                }
            }
        }
    }

    /// Number of coordinates.
    pub fn coordinates(&self) -> usize {
        self.columns.len()
    }

    /// From derivatives by the coordinates of the point `x` to derivatives by its inputs.
    pub fn by_inputs(&self, x: &[f64], by_coordinates: &[f64], by_inputs: &mut [f64]) {
        for (column, derivative) in self.columns.iter().zip(by_coordinates) {
            by_inputs[column.input] += derivative * column.slope(x);
        }
    }

    /// Adds weight * dk(x, x) / dtheta.
    pub fn diagonal_gradient(&self, weight: f64, gradient: &mut [f64]) {
        let mut values = vec![1.0; self.nodes.len()];
        for (index, node) in self.nodes.iter().enumerate() {
            values[index] = match node {
                KernelNode::Leaf(_) => 1.0,
                KernelNode::Scaled { variance, child, .. } => variance * values[*child],
                KernelNode::Sum(children) => children.iter().map(|child| values[*child]).sum(),
                KernelNode::Product(children) => {
                    children.iter().map(|child| values[*child]).product()
                }
            };
        }
        let mut adjoints = vec![0.0; self.nodes.len()];
        adjoints[self.nodes.len() - 1] = weight;
        for (index, node) in self.nodes.iter().enumerate().rev() {
            let adjoint = adjoints[index];
            match node {
                KernelNode::Leaf(_) => {}
                KernelNode::Scaled { variance, theta, child } => {
                    gradient[*theta] += adjoint * values[index];
                    adjoints[*child] = adjoint * variance;
                }
                KernelNode::Sum(children) => {
                    children.iter().for_each(|child| adjoints[*child] = adjoint)
                }
                KernelNode::Product(children) => {
                    children.iter().for_each(|child| {
                        adjoints[*child] = adjoint * values[index] / values[*child]
                    });
                }
            }
        }
    }
}

struct Covariances<'a> {
    plan: &'a Plan,
    points: Features<f64>,
}

impl WithSimd for Covariances<'_> {
    type Output = Vec<f64>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Vec<f64> {
        let Self { plan, points } = self;
        let count = points.count();
        let (mut query, mut work) = (plan.query(), plan.work());
        let mut all = vec![0.0; count * count];
        for (k, row) in all.chunks_exact_mut(count).enumerate() {
            points.point(k, &mut query);
            for (start, length) in points.tiles_from(0) {
                let values =
                    plan.values::<f64, S, false>(simd, &points, (start, length), &query, &mut work);
                let end = (start + length).min(count);
                row[start..end].copy_from_slice(&values[..end - start]);
            }
        }
        all
    }
}
