//! What rooms above make of a log, kept with it.

use std::any::Any;
use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};

/// Values made of the log of a set, for all clones of it; of a log that is in no set nothing is
/// kept.
///
/// It says nothing about the log that the log does not: two logs are equal whatever is kept with
/// them.
#[derive(Clone, Debug, Default)]
pub(super) struct Derived(Option<Arc<Mutex<DerivedValues>>>);

type DerivedValues = VecDeque<Arc<dyn Any + Send + Sync>>;

/// So many values of a type are kept, those used last: processed motion is larger than its log, and
/// a diagnosis looks at it in two bands.
const MOST: usize = 2;

impl Derived {
    /// What keeps values from here on; the same if it does already.
    pub fn on(&self) -> Self {
        Self(Some(self.0.clone().unwrap_or_default()))
    }

    /// What `make` makes, or what it made before, if that `fits`.
    pub fn or_make<T: Any + Send + Sync, E>(
        &self,
        fits: impl Fn(&T) -> bool,
        make: impl FnOnce() -> Result<T, E>,
    ) -> Result<Arc<T>, E> {
        let Some(values) = &self.0 else { return Ok(Arc::new(make()?)) };
        // Not locked while one is made: that may take long, and on threads that wait for others.
        let locked = || values.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(known) = used(&mut locked(), &fits) {
            return Ok(known);
        }
        let made = Arc::new(make()?);
        let mut values = locked();
        if let Some(known) = used(&mut values, &fits) {
            return Ok(known);
        }
        if values.iter().filter(|value| value.is::<T>()).count() >= MOST
            && let Some(oldest) = values.iter().position(|value| value.is::<T>())
        {
            values.remove(oldest);
        }
        values.push_back(made.clone());
        Ok(made)
    }
}

/// The value that fits, which becomes the one used last.
fn used<T: Any + Send + Sync>(
    values: &mut DerivedValues,
    fits: impl Fn(&T) -> bool,
) -> Option<Arc<T>> {
    let place = values.iter().position(|value| value.downcast_ref().is_some_and(&fits))?;
    let value = values.remove(place)?;
    values.push_back(value.clone());
    value.downcast().ok()
}

impl PartialEq for Derived {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_used_last_are_kept_for_clones() {
        let made = std::cell::Cell::new(0);
        let ask = |kept: &Derived, number: i32| {
            let make = || {
                made.set(made.get() + 1);
                Ok::<i32, ()>(number)
            };
            assert_eq!(
                kept.or_make(|known| *known == number, make).map(|value| *value),
                Ok(number)
            );
            made.get()
        };
        let off = Derived::default();
        assert_eq!([ask(&off, 1), ask(&off, 1)], [1, 2], "nothing is kept");
        let kept = off.on();
        let clone = kept.on();
        assert_eq!([ask(&kept, 1), ask(&clone, 1), ask(&kept, 2), ask(&clone, 1)], [3, 3, 4, 4]);
        // The third takes the place of the second: the first was used after that.
        assert_eq!([ask(&kept, 3), ask(&kept, 1), ask(&kept, 2)], [5, 5, 6]);
        // Values of another type have places of their own.
        assert_eq!(kept.or_make(|_: &u8| true, || Ok::<u8, ()>(7)).map(|value| *value), Ok(7));
        assert_eq!(ask(&kept, 1), 6);
    }
}
