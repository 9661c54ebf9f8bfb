//! Random arms and random motion.

use sgpr_core::robot::{DhConvention, DhRow, Robot, STANDARD_GRAVITY};

/// SplitMix64 (Steele, Lea, Flood (2014)).
pub struct Random(pub u64);

impl Random {
    pub fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.uniform()
    }

    pub fn logarithmic(&mut self, low: f64, high: f64) -> f64 {
        low * (high / low).powf(self.uniform())
    }

    pub fn normal(&mut self) -> f64 {
        let radius = (-2.0 * self.uniform().max(1e-300).ln()).sqrt();
        radius * (std::f64::consts::TAU * self.uniform()).cos()
    }

    pub fn sign(&mut self) -> f64 {
        if self.uniform() < 0.5 { -1.0 } else { 1.0 }
    }

    pub fn below(&mut self, count: usize) -> usize {
        ((self.uniform() * count as f64) as usize).min(count - 1)
    }
}

/// An arm of five to seven joints, a shoulder that lifts, links that get lighter.
pub fn arm(random: &mut Random) -> Robot {
    let n = 5 + random.below(3);
    let quarter = std::f64::consts::FRAC_PI_2;
    let twists = [quarter, 0.0, -quarter, quarter, -quarter, quarter, 0.0];
    let mut mass = random.between(4.0, 20.0);
    let mut reach = random.between(0.25, 0.5);
    let rows: Vec<DhRow> = (0..n)
        .map(|joint| {
            let twist = if n == 7 && joint == 1 { quarter } else { twists[joint] };
            let (a, d) = if joint == 1 {
                (reach, 0.0)
            } else {
                (random.between(0.0, 0.08), random.between(0.0, reach))
            };
            let radius = 0.15 + 0.25 * reach;
            let diagonal: [f64; 3] =
                std::array::from_fn(|_| mass * radius * radius * random.between(0.15, 0.4));
            let centre: [f64; 3] = std::array::from_fn(|_| random.between(-0.4, 0.4) * reach);
            let inertia =
                [[diagonal[0], 0.0, 0.0], [0.0, diagonal[1], 0.0], [0.0, 0.0, diagonal[2]]];
            let row = DhRow::revolute(a, twist, d, 0.0).with_body(mass, centre, inertia);
            mass *= random.between(0.35, 0.8);
            reach *= random.between(0.55, 0.95);
            row
        })
        .collect();
    Robot::from_dh("arm", DhConvention::Standard, &rows, None, STANDARD_GRAVITY)
        .expect("a valid table")
}

/// A Fourier series per joint.
pub struct Motion {
    /// Per joint: centre, and per harmonic amplitude of sine and cosine.
    joints: Vec<(f64, Vec<[f64; 2]>)>,
    pulse: f64,
}

impl Motion {
    pub fn new(n: usize, random: &mut Random, slowness: f64) -> Self {
        let pulse = std::f64::consts::TAU / (random.between(9.0, 16.0) * slowness);
        let joints = (0..n)
            .map(|_| {
                let size = random.between(0.3, 0.9);
                let harmonic = |k: usize, random: &mut Random| {
                    [random.normal(), random.normal()].map(|x| size * x / (k as f64).powf(1.2))
                };
                let harmonics = (1..=5).map(|k| harmonic(k, random)).collect();
                (random.between(-0.8, 0.8), harmonics)
            })
            .collect();
        Self { joints, pulse }
    }

    /// Motions in which each joint swings about one position with one frequency, from another phase
    /// each time.
    pub fn swinging(n: usize, random: &mut Random, count: usize) -> Vec<Self> {
        const HARMONICS: usize = 5;
        let pulse = std::f64::consts::TAU / random.between(9.0, 16.0);
        let own: Vec<(f64, f64, usize)> = (0..n)
            .map(|_| {
                (random.between(-0.8, 0.8), random.between(0.3, 0.9), 1 + random.below(HARMONICS))
            })
            .collect();
        let motion = |random: &mut Random| {
            let joint = |(centre, size, harmonic): &(f64, f64, usize), random: &mut Random| {
                let (s, c) = random.between(0.0, std::f64::consts::TAU).sin_cos();
                let mut harmonics = vec![[0.0; 2]; HARMONICS];
                harmonics[harmonic - 1] = [s, c].map(|x| size * x / (*harmonic as f64).sqrt());
                (*centre, harmonics)
            };
            Self { joints: own.iter().map(|own| joint(own, random)).collect(), pulse }
        };
        (0..count).map(|_| motion(random)).collect()
    }

    /// Position, velocity, acceleration of each joint at a time.
    pub fn at(&self, time: f64) -> [Vec<f64>; 3] {
        let mut result = [vec![], vec![], vec![]];
        for (centre, harmonics) in &self.joints {
            let mut state = [*centre, 0.0, 0.0];
            for (k, [a, b]) in harmonics.iter().enumerate() {
                let w = (k + 1) as f64 * self.pulse;
                let (s, c) = (w * time).sin_cos();
                state[0] += a * s + b * c;
                state[1] += w * (a * c - b * s);
                state[2] -= w * w * (a * s + b * c);
            }
            result.iter_mut().zip(state).for_each(|(list, value)| list.push(value));
        }
        result
    }
}
