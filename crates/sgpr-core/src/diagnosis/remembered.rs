//! What many models say of the same motion.

use std::collections::HashMap;
use std::hash::Hash;
use std::sync::{Arc, Mutex, PoisonError};

use crate::dynamics::Samples;
use crate::effects::{Context, Reach, Site};
use crate::model::{AlongMotion, Term, TorqueModel};

/// What a term is remembered by: effect, site and the bits of its constants.
pub(super) type TermKey = (String, Site, Vec<u64>);

/// That of a term.
pub(super) fn key_of(term: &Term) -> TermKey {
    (term.effect.name().to_string(), term.site, bits(&term.constants))
}

fn bits(values: &[f64]) -> Vec<u64> {
    values.iter().map(|value| value.to_bits()).collect()
}

/// Values along stretches of motion by what they are of and the index of the stretch, as long as
/// there is room.
#[derive(Debug)]
struct Store<K, V>(Mutex<StoredValues<K, V>>);

#[derive(Debug)]
struct StoredValues<K, V> {
    values: HashMap<(K, usize), Arc<V>>,
    /// How many numbers they are.
    size: usize,
}

impl<K: Eq + Hash, V> Store<K, V> {
    /// Those of `key`, made if they are not known.
    ///
    /// - `size`: how many numbers they are
    fn get(&self, key: (K, usize), make: impl FnOnce() -> V, size: impl Fn(&V) -> usize) -> Arc<V> {
        /// Most numbers that are kept: 64 MiB.
        const MOST: usize = 1 << 23;
        let known = || self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(values) = known().values.get(&key) {
            return values.clone();
        }
        // No lock is held meanwhile.
        let made = Arc::new(make());
        let mut known = known();
        if known.size + size(&made) > MOST {
            *known = StoredValues::default();
        }
        known.size += size(&made);
        known.values.insert(key, made.clone());
        made
    }
}

impl<K, V> Default for Store<K, V> {
    fn default() -> Self {
        Self(Mutex::default())
    }
}

impl<K, V> Default for StoredValues<K, V> {
    fn default() -> Self {
        Self { values: HashMap::new(), size: 0 }
    }
}

/// What depends on the measured motion of stretches alone.
#[derive(Debug, Default)]
pub(super) struct Remembered {
    /// Columns of terms.
    columns: Store<TermKey, Vec<Vec<f64>>>,
    /// Torque of what a model has everywhere, by its parameters.
    effects: Store<Vec<u64>, Vec<f64>>,
}

impl Remembered {
    pub fn along(&self, stretch: usize) -> Along<'_> {
        Along { remembered: self, stretch }
    }
}

/// What is remembered of a stretch.
pub(super) struct Along<'a> {
    remembered: &'a Remembered,
    stretch: usize,
}

impl AlongMotion for Along<'_> {
    fn columns(&self, term: &Term, context: &Context<'_>) -> Arc<Vec<Vec<f64>>> {
        let of_motion = term.effect.reach() == Reach::Own
            && !term.is_transform()
            && !term.effect.follows_torque();
        let make = || term.columns(context);
        if !of_motion {
            return make().into();
        }
        let size = |columns: &Vec<Vec<f64>>| columns.iter().map(Vec::len).sum();
        self.remembered.columns.get((key_of(term), self.stretch), make, size)
    }

    fn effects(&self, model: &TorqueModel, samples: Samples<'_>) -> Arc<Vec<f64>> {
        let of_effects = &model.parameters()[model.parameter_set().inertial()..];
        self.remembered.effects.get(
            (bits(of_effects), self.stretch),
            || model.effects_along(samples),
            Vec::len,
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::by_name;
    use crate::model::Trajectory;
    use crate::robot::two_link;

    #[test]
    fn what_is_remembered_changes_no_torque() {
        let term = |name: &str, site, constants: &[f64], factor: f64| {
            let mut term =
                Term::new(by_name(name).expect("in the library"), site, constants.to_vec());
            term.coefficients.fill(factor);
            term
        };
        let wave = |k: usize, rate: f64| (0..200).map(move |t| (rate * (t + 37 * k) as f64).sin());
        let of = |rate: f64| -> Vec<f64> {
            wave(0, rate).zip(wave(1, rate)).flat_map(|(a, b)| [a, b]).collect()
        };
        let (q, dq, ddq) = (of(0.05), of(0.07), of(0.11));
        let along = Trajectory {
            samples: Samples { q: &q, dq: &dq, ddq: &ddq },
            rate_hz: 100.0,
            time: &[],
            channels: &[],
        };
        let remembered = Remembered::default();
        let robot = two_link();
        for friction in [0.3, 0.4] {
            let parameters = [robot.standard_parameters(), vec![friction; 4]].concat();
            let effects = ["viscous_friction", "coulomb_friction"];
            let model = TorqueModel::with_parameters(&robot, &effects, parameters)
                .expect("parameters of both effects");
            for tilt in [0.0, 0.1] {
                // One that follows the motion, one that follows the torque, and one that moves
                // gravity.
                let terms = vec![
                    term("presliding_friction", Site::Joint(0), &[0.02], 0.7),
                    term("load_dependent_friction", Site::Joint(1), &[], 0.1),
                    term("base_tilt", Site::Arm, &[tilt, 0.0], 0.0),
                ];
                let model = model.clone().with_terms(terms, None);
                let pairs = model.predict_with(&along, &remembered.along(0)).into_iter();
                for (own, torque) in pairs.zip(model.predict_trajectory(&along)) {
                    assert!((own - torque).abs() < 1e-12 * (1.0 + torque.abs()), "{own} {torque}");
                }
            }
        }
    }
}
