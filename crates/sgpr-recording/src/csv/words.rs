//! Column names cut into words, and what the words can mean.

use std::ops::Range;

use super::quantity::{Label, Meaning, Quantity, StatedUnit};

/// Signs of degrees that are neither letters nor digits.
const DEGREE_SIGNS: [char; 5] = ['°', '˚', '∘', '¡', '\u{fffd}'];
/// Units that may as well be the name of a joint.
const NAMES_OF_JOINTS: [&str; 4] = ["turn", "turns", "rev", "revolutions"];
/// Words that say "this is the measurement".
const MEASURED: [&str; 5] = ["actual", "act", "measured", "meas", "msr"];
/// Words around a number or a name that say nothing more.
const FILLERS: [&str; 10] =
    ["joint", "joints", "j", "axis", "state", "states", "achse", "gelenk", "axe", "articulation"];
/// Words that are not part of the name of a joint: what they mark is no plain measurement.
const NOT_A_JOINT: &str = " ref reference des desired d target cmd command commanded commands goal \
     setpoint sp err error est estimated ext external raw limit min max temperature model motor \
     soll consigne ";

/// A column name cut into words at separators and between letters and digits.
#[derive(Clone)]
pub(super) struct Words<'a> {
    name: &'a str,
    places: Vec<Range<usize>>,
    lower: Vec<String>,
}

impl<'a> Words<'a> {
    pub(super) fn of(name: &'a str) -> Self {
        let mut places: Vec<Range<usize>> = Vec::new();
        let mut former: Option<char> = None;
        for (at, letter) in name.char_indices() {
            let end = at + letter.len_utf8();
            let is_word = letter.is_alphanumeric() || DEGREE_SIGNS.contains(&letter);
            let continues = former.is_some_and(|former| former.is_numeric() == letter.is_numeric());
            match places.last_mut() {
                Some(place) if is_word && continues => place.end = end,
                _ if is_word => places.push(at..end),
                _ => {}
            }
            former = is_word.then_some(letter);
        }
        let lower = places.iter().map(|place| name[place.clone()].to_lowercase()).collect();
        Self { name, places, lower }
    }

    /// The words in lower case.
    pub(super) fn lower(&self) -> Vec<&str> {
        self.lower.iter().map(String::as_str).collect()
    }

    fn len(&self) -> usize {
        self.lower.len()
    }

    fn text(&self, word: usize) -> &'a str {
        &self.name[self.places[word].clone()]
    }

    /// Where the words of `joint` stand in a row.
    pub(super) fn find(&self, joint: &str) -> Option<Range<usize>> {
        let joint = Words::of(joint);
        let last_start = self.len().checked_sub(joint.len())?;
        let is_here = |start: &usize| {
            (0..joint.len()).all(|word| self.text(start + word) == joint.text(word))
        };
        let start = (0..=last_start).find(is_here)?;
        (joint.len() > 0).then(|| start..start + joint.len())
    }

    pub(super) fn without(&self, removed: Range<usize>) -> Self {
        let mut rest = self.clone();
        rest.places.drain(removed.clone());
        rest.lower.drain(removed);
        rest
    }

    /// Quantity and unit, if there is nothing else.
    pub(super) fn quantity_alone(&self) -> Option<(Quantity, Option<StatedUnit>)> {
        let readings = self.readings();
        let complete = readings.into_iter().find(|reading| reading.rest.is_filler());
        complete.map(|reading| (reading.quantity, reading.unit))
    }

    /// Quantity, unit and joint; `free` if the joint may have any name.
    pub(super) fn quantity_and_label(&self, free: bool) -> Option<Meaning> {
        self.readings().into_iter().find_map(|reading| {
            let Reading { quantity, unit, rest, symbol } = reading;
            let any_name = || if free && !symbol { rest.joint_name() } else { None };
            let label = rest.number_or_nothing().or_else(any_name)?;
            Some(Meaning { quantity, label, unit })
        })
    }

    /// Every way to read one word as the quantity and others as its unit.
    fn readings(&self) -> Vec<Reading<'a>> {
        let mut readings = Vec::new();
        for quantity in Quantity::ALL {
            for word in 0..self.len() {
                let symbol = quantity.symbols().contains(&self.lower[word].as_str());
                if !symbol && !quantity.words().contains(&self.lower[word].as_str()) {
                    continue;
                }
                let rest = self.without(word..word + 1);
                // A torque in ampere is a current.
                let kinds =
                    [Some(quantity), (quantity == Quantity::Torque).then_some(Quantity::Current)];
                for quantity in kinds.into_iter().flatten() {
                    if let Some((place, unit)) = rest.unit(quantity, word) {
                        readings.push(Reading {
                            quantity,
                            unit: Some(unit),
                            rest: rest.without(place),
                            symbol,
                        });
                    }
                }
                readings.push(Reading { quantity, unit: None, rest, symbol });
            }
        }
        readings
    }

    /// A unit of `quantity` at `after`, or behind it at the end, the longest first, with its
    /// factor. What stands before the quantity is no unit: a joint may be called `turn`.
    fn unit(&self, quantity: Quantity, after: usize) -> Option<(Range<usize>, StatedUnit)> {
        let at_end = [2, 1]
            .into_iter()
            .filter_map(|length| Some(self.len().checked_sub(length)?..self.len()));
        let at_end = at_end.filter(|place| place.start >= after);
        let behind = [2, 1]
            .map(|length| after..after + length)
            .into_iter()
            .filter(|place| place.end <= self.len());
        at_end
            .chain(behind)
            .find_map(|place| self.spelled_unit(quantity, &place).map(|unit| (place, unit)))
    }

    /// The unit that the words at `place` spell.
    fn spelled_unit(&self, quantity: Quantity, place: &Range<usize>) -> Option<StatedUnit> {
        let spelled: Vec<&str> = place.clone().map(|word| self.text(word)).collect();
        quantity.unit(&spelled.join("_"))
    }

    /// The unit in which the name ends, behind words that are not understood.
    pub(super) fn unit_at_end(&self, quantity: Quantity) -> Option<StatedUnit> {
        let places = [2, 1]
            .into_iter()
            .filter_map(|length| Some(self.len().checked_sub(length)?..self.len()));
        let may_be_a_unit = |place: &Range<usize>| {
            place.start > 0 && !NAMES_OF_JOINTS.contains(&self.lower[place.start].as_str())
        };
        places.filter(may_be_a_unit).find_map(|place| self.spelled_unit(quantity, &place))
    }

    /// Whether there are only words that say nothing of a unit: what is measured, and numbers.
    pub(super) fn says_nothing(&self) -> bool {
        let is_number = |word: &str| word.chars().all(|letter| letter.is_ascii_digit());
        let is_quantity =
            |word: &str| Quantity::ALL.iter().any(|quantity| quantity.words().contains(&word));
        let means_nothing = |word: &&str| {
            FILLERS.contains(word)
                || MEASURED.contains(word)
                || is_number(word)
                || is_quantity(word)
        };
        self.lower().iter().all(means_nothing)
    }

    /// Whether the words say nothing more.
    fn is_filler(&self) -> bool {
        self.lower().iter().all(|word| FILLERS.contains(word) || MEASURED.contains(word))
    }

    /// The joint, if it has a number or no name.
    fn number_or_nothing(&self) -> Option<Label> {
        let number = |word: usize| self.lower[word].parse::<u32>().ok();
        match (0..self.len()).find_map(|word| Some((word, number(word)?))) {
            None => self.is_filler().then_some(Label::Unnamed),
            Some((word, number)) => {
                self.without(word..word + 1).is_filler().then_some(Label::Number(number))
            }
        }
    }

    /// The words as the name of a joint, if they stand in a row and none of them speaks against it.
    fn joint_name(&self) -> Option<Label> {
        let lower = self.lower();
        let from = if lower.starts_with(&["joint", "states"]) { 2 } else { 0 };
        let words: Vec<usize> =
            (from..self.len()).filter(|&word| !MEASURED.contains(&lower[word])).collect();
        let (first, last) = (*words.first()?, *words.last()?);
        let name = &self.name[self.places[first].start..self.places[last].end];
        let in_a_row = Words::of(name).len() == words.len();
        let is_quantity = |word: &str| {
            Quantity::ALL.iter().any(|quantity| {
                quantity.words().contains(&word) || quantity.symbols().contains(&word)
            })
        };
        let speaks_against =
            |word: &str| is_quantity(word) || NOT_A_JOINT.contains(&format!(" {word} "));
        let is_name = in_a_row && !words.iter().any(|&word| speaks_against(lower[word]));
        is_name.then(|| Label::Name(name.into()))
    }
}

/// One way to understand a name.
struct Reading<'a> {
    quantity: Quantity,
    unit: Option<StatedUnit>,
    /// Words besides quantity and unit.
    rest: Words<'a>,
    /// Whether the quantity is a short symbol.
    symbol: bool,
}
