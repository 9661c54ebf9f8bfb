//! Butterworth low-pass, applied forwards and backwards.

// Loops over registers by index: iterators and closures between the instructions of a register need
// not become part of the function that has the instruction set, and are then slow.

use pulp::{Arch, Simd, WithSimd};

use super::SignalError;
use super::butterworth::{Section, sections};

/// Lowest cut-off, as a share of the sampling rate. The gain of a section is (pi fc / fs)², what is
/// left of a sum of numbers near one: below this it has less than six digits.
const LOWEST_CUTOFF: f64 = 1e-5;

/// A Butterworth low-pass without phase: it runs forwards and backwards over the signal, so that
/// its gain is the squared Butterworth gain, one half of the amplitude at the cut-off, and no edge
/// is shifted in time.
///
/// The ends are extended by reflection through the end points, as `scipy.signal.sosfiltfilt` does.
/// The filter is linear in the signal, ends included: filtering all columns and the right-hand side
/// of an equation leaves it an equation.
///
/// # Examples
/// ```
/// use sgpr_predict::signal::LowPass;
/// let filter = LowPass::butterworth(4, 5.0, 100.0)?;
/// let mut ramp: Vec<f64> = (0..200).map(f64::from).collect();
/// filter.apply(&mut ramp, 1)?;
/// assert!((ramp[100] - 100.0).abs() < 1e-5);
/// # Ok::<(), sgpr_predict::signal::SignalError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct LowPass {
    order: usize,
    cutoff_hz: f64,
    rate_hz: f64,
    sections: Vec<Section>,
}

/// Highest order of one pass.
pub const HIGHEST_ORDER: usize = 10;

impl LowPass {
    /// Low-pass of `order` (of one pass) with its cut-off at `cutoff_hz` for signals sampled at
    /// `rate_hz`.
    ///
    /// # Errors
    /// If the cut-off is not between a hundred-thousandth and half of the sampling rate, or the
    /// order not between 1 and 10.
    pub fn butterworth(order: usize, cutoff_hz: f64, rate_hz: f64) -> Result<Self, SignalError> {
        if !(1..=HIGHEST_ORDER).contains(&order) {
            return Err(SignalError::Order { order });
        }
        if !(cutoff_hz >= LOWEST_CUTOFF * rate_hz && cutoff_hz < 0.5 * rate_hz) {
            let lowest_hz = LOWEST_CUTOFF * rate_hz;
            return Err(SignalError::CutoffOutOfRange { cutoff_hz, rate_hz, lowest_hz });
        }
        let sections = sections(order, cutoff_hz / rate_hz);
        Ok(Self { order, cutoff_hz, rate_hz, sections })
    }

    /// Cut-off, Hz: half of the amplitude passes.
    pub fn cutoff_hz(&self) -> f64 {
        self.cutoff_hz
    }

    /// Order of one pass.
    pub fn order(&self) -> usize {
        self.order
    }

    /// Share of the amplitude of a sine at `frequency_hz` that passes.
    pub fn gain(&self, frequency_hz: f64) -> f64 {
        // The bilinear transform warps frequencies by the tangent.
        let warp = |f: f64| (std::f64::consts::PI * f / self.rate_hz).tan();
        let ratio = warp(frequency_hz) / warp(self.cutoff_hz);
        1.0 / (1.0 + ratio.powi(2 * self.order as i32))
    }

    /// Samples at either end where the reflected extension still shows by more than one percent.
    pub fn settling_samples(&self) -> usize {
        // The slowest analog pole of a Butterworth filter decays with 2 pi fc sin(pi / 2 order).
        let decay = std::f64::consts::TAU
            * self.cutoff_hz
            * (std::f64::consts::FRAC_PI_2 / self.order as f64).sin();
        (100f64.ln() / decay * self.rate_hz).ceil() as usize
    }

    /// Samples by which either end is extended; as many as `scipy.signal.sosfiltfilt` takes.
    fn extension(&self) -> usize {
        let zeros =
            |select: fn(&Section) -> f64| self.sections.iter().filter(|s| select(s) == 0.0).count();
        let taps = 2 * self.sections.len() + 1 - zeros(|s| s.b[2]).min(zeros(|s| s.a[1]));
        3 * taps
    }

    /// Filters every column of `values`, `[samples, columns]` row-major, in place.
    ///
    /// # Errors
    /// If there are no more samples than the extension of the ends needs.
    ///
    /// # Panics
    /// If `values` does not hold whole rows.
    pub fn apply(&self, values: &mut [f64], columns: usize) -> Result<(), SignalError> {
        assert!(
            columns > 0 && values.len().is_multiple_of(columns),
            "whole rows of {columns} columns"
        );
        self.check_length(values.len() / columns)?;
        Arch::new().dispatch(ForwardBackward {
            filter: self,
            values,
            columns,
            extension: self.extension(),
        });
        Ok(())
    }

    /// Whether so many samples are enough for [`Self::apply`].
    ///
    /// # Errors
    /// If they are not more than either end is extended by.
    pub fn check_length(&self, samples: usize) -> Result<(), SignalError> {
        let needed = self.extension();
        if samples > needed { Ok(()) } else { Err(SignalError::TooShort { samples, needed }) }
    }
}

impl LowPass {
    /// Filters every column of `values`, `[samples, columns]` row-major, in place and forwards
    /// alone, as a filter does that does not know what comes: the result is late. It starts settled
    /// at the first row.
    ///
    /// # Panics
    /// If `values` does not hold whole rows.
    pub fn apply_forwards(&self, values: &mut [f64], columns: usize) {
        assert!(
            columns > 0 && values.len().is_multiple_of(columns),
            "whole rows of {columns} columns"
        );
        let Some(first) = values.get(..columns) else { return };
        let mut state = State::at_rest(&self.sections, first);
        values.chunks_exact_mut(columns).for_each(|row| state.advance(&self.sections, row));
    }
}

struct ForwardBackward<'a> {
    filter: &'a LowPass,
    values: &'a mut [f64],
    columns: usize,
    extension: usize,
}

impl WithSimd for ForwardBackward<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { filter, values, columns, extension } = self;
        let registers = columns.div_ceil(S::F64_LANES);
        let groups = registers.div_ceil(MOST_REGISTERS);
        let mut first = 0;
        for group in 0..groups {
            // As equal as they can be: a register alone would wait for its own results.
            let end = registers * (group + 1) / groups;
            let own = first * S::F64_LANES..(end * S::F64_LANES).min(columns);
            let table = Table { values, columns, own };
            match end - first {
                1 => table.filter::<S, 1>(simd, &filter.sections, extension),
                2 => table.filter::<S, 2>(simd, &filter.sections, extension),
                3 => table.filter::<S, 3>(simd, &filter.sections, extension),
                _ => table.filter::<S, MOST_REGISTERS>(simd, &filter.sections, extension),
            }
            first = end;
        }
    }
}

/// Registers of columns that go through the filter beside each other: each waits for its own
/// results, the others work meanwhile.
const MOST_REGISTERS: usize = 4;

/// Neighbouring columns, as many as `G` registers hold, the last one perhaps not full.
struct Table<'a> {
    values: &'a mut [f64],
    columns: usize,
    own: std::ops::Range<usize>,
}

impl Table<'_> {
    #[inline(always)]
    fn filter<S: Simd, const G: usize>(self, simd: S, sections: &[Section], extension: usize) {
        match sections.len() {
            1 => self.forwards_and_backwards::<S, G, 1>(simd, sections, extension),
            2 => self.forwards_and_backwards::<S, G, 2>(simd, sections, extension),
            3 => self.forwards_and_backwards::<S, G, 3>(simd, sections, extension),
            4 => self.forwards_and_backwards::<S, G, 4>(simd, sections, extension),
            count => {
                assert!(
                    count == HIGHEST_ORDER.div_ceil(2),
                    "as many sections as the highest order has, at most"
                );
                self.forwards_and_backwards::<S, G, 5>(simd, sections, extension);
            }
        }
    }

    #[inline(always)]
    fn forwards_and_backwards<S: Simd, const G: usize, const N: usize>(
        mut self,
        simd: S,
        sections: &[Section],
        extension: usize,
    ) {
        let samples = self.values.len() / self.columns;
        let (start, end) = (self.load::<S, G>(simd, 0), self.load::<S, G>(simd, samples - 1));
        let mut after = vec![end; extension];
        for (k, row) in after.iter_mut().enumerate() {
            *row = mirrored(simd, end, self.load(simd, samples - 2 - k));
        }

        let first = mirrored(simd, start, self.load(simd, extension));
        let mut state = Registers::<S, G, N>::at_rest(simd, sections, first);
        for k in (1..=extension).rev() {
            state.advance(simd, mirrored(simd, start, self.load(simd, k)));
        }
        for row in 0..samples {
            let filtered = state.advance(simd, self.load(simd, row));
            self.store::<S, G>(simd, row, filtered);
        }
        for row in &mut after {
            *row = state.advance(simd, *row);
        }

        let mut state = Registers::<S, G, N>::at_rest(simd, sections, after[extension - 1]);
        for row in after.iter().rev() {
            state.advance(simd, *row);
        }
        for row in (0..samples).rev() {
            let filtered = state.advance(simd, self.load(simd, row));
            self.store::<S, G>(simd, row, filtered);
        }
    }

    #[inline(always)]
    fn load<S: Simd, const G: usize>(&self, simd: S, row: usize) -> [S::f64s; G] {
        let row = &self.values[row * self.columns..][self.own.clone()];
        let mut registers = [simd.splat_f64s(0.0); G];
        for g in 0..G {
            let rest = &row[g * S::F64_LANES..];
            let (whole, _) = S::as_simd_f64s(rest);
            registers[g] = if whole.is_empty() { simd.partial_load_f64s(rest) } else { whole[0] };
        }
        registers
    }

    #[inline(always)]
    fn store<S: Simd, const G: usize>(&mut self, simd: S, row: usize, registers: [S::f64s; G]) {
        let row = &mut self.values[row * self.columns..][self.own.clone()];
        for g in 0..G {
            let rest = &mut row[g * S::F64_LANES..];
            if rest.len() >= S::F64_LANES {
                S::as_mut_simd_f64s(rest).0[0] = registers[g];
            } else {
                simd.partial_store_f64s(rest, registers[g]);
            }
        }
    }
}

/// Rows before the first and after the last: twice the end minus the mirror image.
#[inline(always)]
fn mirrored<S: Simd, const G: usize>(
    simd: S,
    end: [S::f64s; G],
    inside: [S::f64s; G],
) -> [S::f64s; G] {
    let mut row = end;
    for g in 0..G {
        row[g] = simd.sub_f64s(simd.add_f64s(end[g], end[g]), inside[g]);
    }
    row
}

/// Sections with what they remember of `G` registers of columns (transposed direct form II).
struct Registers<S: Simd, const G: usize, const N: usize> {
    /// Per section: b0, b1, b2, -a1, -a2.
    factors: [[S::f64s; 5]; N],
    memory: [[[S::f64s; G]; 2]; N],
}

impl<S: Simd, const G: usize, const N: usize> Registers<S, G, N> {
    /// The state in which a constant signal at `level` passes unchanged.
    #[inline(always)]
    fn at_rest(simd: S, sections: &[Section], level: [S::f64s; G]) -> Self {
        let zero = simd.splat_f64s(0.0);
        let (mut factors, mut memory) = ([[zero; 5]; N], [[[zero; G]; 2]; N]);
        for k in 0..N {
            let Section { b, a, steady } = &sections[k];
            factors[k] = [b[0], b[1], b[2], -a[0], -a[1]].map(|factor| simd.splat_f64s(factor));
            for g in 0..G {
                memory[k][0][g] = simd.mul_f64s(simd.splat_f64s(steady[0]), level[g]);
                memory[k][1][g] = simd.mul_f64s(simd.splat_f64s(steady[1]), level[g]);
            }
        }
        Self { factors, memory }
    }

    #[inline(always)]
    fn advance(&mut self, simd: S, mut row: [S::f64s; G]) -> [S::f64s; G] {
        for k in 0..N {
            let [b0, b1, b2, a1, a2] = self.factors[k];
            let [mut first, mut second] = self.memory[k];
            for g in 0..G {
                let y = simd.mul_add_f64s(b0, row[g], first[g]);
                first[g] = simd.mul_add_f64s(a1, y, simd.mul_add_f64s(b1, row[g], second[g]));
                second[g] = simd.mul_add_f64s(a2, y, simd.mul_f64s(b2, row[g]));
                row[g] = y;
            }
            self.memory[k] = [first, second];
        }
        row
    }
}

/// What the sections remember, per section and column (transposed direct form II).
struct State {
    memory: Vec<[Vec<f64>; 2]>,
}

impl State {
    /// The state in which a constant signal at `level` passes unchanged.
    fn at_rest(sections: &[Section], level: &[f64]) -> Self {
        let scaled = |factor: f64| level.iter().map(|x| factor * x).collect::<Vec<_>>();
        Self { memory: sections.iter().map(|section| section.steady.map(scaled)).collect() }
    }

    #[inline(always)]
    fn advance(&mut self, sections: &[Section], row: &mut [f64]) {
        for (section, [first, second]) in sections.iter().zip(&mut self.memory) {
            let Section { b, a, .. } = section;
            for ((x, z1), z2) in row.iter_mut().zip(first).zip(second) {
                let y = b[0] * *x + *z1;
                *z1 = b[1] * *x - a[0] * y + *z2;
                *z2 = b[2] * *x - a[1] * y;
                *x = y;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `scipy.signal.sosfiltfilt(butter(order, cutoff, fs=100, output="sos"), x)` with SciPy 1.17.1
    /// for x = sin(k) + 0.1 k - 0.02 (k mod 7)², k = 0..79; values at k = 0, 1, 39, 78, 79.
    #[test]
    fn agrees_with_scipy_ends_included() {
        let x: Vec<f64> = (0..80)
            .map(|k| f64::from(k).sin() + 0.1 * f64::from(k) - 0.02 * f64::from(k % 7).powi(2))
            .collect();
        for (order, cutoff, expected) in SCIPY {
            let filter = LowPass::butterworth(order, cutoff, 100.0).expect("a valid filter");
            // Of a long memory SciPy keeps less: its gain of a constant is off by eps / (pi fc /
            // fs)^order.
            let tolerance = if cutoff < 5.0 { 1e-10 } else { 1e-12 };
            // Beside other columns, which must not leak in.
            let mut table: Vec<f64> = x.iter().flat_map(|x| [1e3, *x, -x]).collect();
            filter.apply(&mut table, 3).expect("long enough");
            for (row, expected) in [0, 1, 39, 78, 79].into_iter().zip(expected) {
                let found = table[3 * row + 1];
                assert!(
                    (found - expected).abs() < tolerance,
                    "order {order}, {cutoff} Hz, row {row}: {found} {expected}"
                );
                assert!((table[3 * row] - 1e3).abs() < 1e-9 && table[3 * row + 2] == -found);
            }
        }
    }

    const SCIPY: [(usize, f64, [f64; 5]); 7] = [
        (
            1,
            3.0,
            [
                0.23380712953017543,
                0.28104069429299144,
                3.6631778775257415,
                7.275172904893689,
                7.286682265357877,
            ],
        ),
        (
            5,
            2.0,
            [
                -0.08899111797997071,
                -0.014757979452586497,
                3.6372758369594904,
                6.738035263787043,
                6.751358255944071,
            ],
        ),
        (
            7,
            12.0,
            [
                0.003747919893656518,
                -0.008290373401862443,
                3.640933125785552,
                7.416997790742315,
                7.373321417826929,
            ],
        ),
        (
            8,
            5.0,
            [
                -0.0012054086290491136,
                0.05042148144216628,
                3.6421934013445534,
                7.344734923078737,
                7.412502788776123,
            ],
        ),
        (
            9,
            45.0,
            [
                -0.0013675698274453474,
                0.9168232893395756,
                4.546962431511974,
                8.277321197809151,
                7.384939451682056,
            ],
        ),
        (
            10,
            8.0,
            [
                0.006706076882927766,
                0.01849207841324377,
                3.64084277993312,
                7.3605230259056205,
                7.379379227394042,
            ],
        ),
        (
            10,
            30.0,
            [
                -0.00026715750693417917,
                0.9156883529602995,
                4.580984705610906,
                8.455369274134082,
                7.375212947016232,
            ],
        ),
    ];

    #[test]
    fn gain_is_that_of_a_long_sine() {
        let filter = LowPass::butterworth(4, 8.0, 200.0).expect("a valid filter");
        for frequency in [2.0, 8.0, 13.0] {
            let sine = |k: usize| (std::f64::consts::TAU * frequency * k as f64 / 200.0).sin();
            let mut values: Vec<f64> = (0..4000).map(sine).collect();
            filter.apply(&mut values, 1).expect("long enough");
            let inner = 1000..3000;
            let along: f64 = inner.clone().map(|k| values[k] * sine(k)).sum();
            let mean = along / inner.map(|k| sine(k).powi(2)).sum::<f64>();
            assert!(
                (mean - filter.gain(frequency)).abs() < 1e-3,
                "{frequency} Hz: {mean} {}",
                filter.gain(frequency)
            );
        }
    }

    #[test]
    fn a_constant_passes_unchanged() {
        for (order, cutoff) in [(1, 400.0), (3, 1.0), (4, 0.01), (10, 0.01)] {
            let filter = LowPass::butterworth(order, cutoff, 1000.0).expect("a valid filter");
            let mut values = vec![7.5; 100];
            filter.apply(&mut values, 1).expect("long enough");
            assert!(
                values.iter().all(|x| (x - 7.5).abs() < 1e-9),
                "order {order}, {cutoff} Hz: {values:?}"
            );
        }
    }

    #[test]
    fn impossible_filters_are_refused_with_advice() {
        let message = LowPass::butterworth(4, 60.0, 100.0).expect_err("above Nyquist").to_string();
        assert!(message.contains("between 1.0e-3 and 50 Hz"), "{message}");
        for cutoff in [0.0, -1.0, 1e-300, 9.9e-4, 50.0, f64::INFINITY] {
            assert!(LowPass::butterworth(4, cutoff, 100.0).is_err(), "{cutoff}");
        }
        assert!(LowPass::butterworth(4, 1.0, f64::INFINITY).is_err());
        assert!(LowPass::butterworth(4, f64::NAN, 100.0).is_err());
        assert!(LowPass::butterworth(0, 10.0, 100.0).is_err());
        let filter = LowPass::butterworth(4, 5.0, 100.0).expect("a valid filter");
        let message = filter.apply(&mut [0.0; 15], 1).expect_err("too short").to_string();
        assert!(
            message.contains("15 samples are too few") && message.contains("record longer"),
            "{message}"
        );
    }
}
