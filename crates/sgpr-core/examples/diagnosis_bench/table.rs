//! What comes out, by condition.

use std::fmt;

/// Figures of cases of one kind.
#[derive(Clone, Debug, Default)]
pub struct Row {
    pub cases: usize,
    /// Effects of the catalogue that were hidden and raise the error, and those of them that are
    /// among the findings.
    pub wanted: usize,
    pub found: usize,
    /// Cases with such effects, and those in which the first finding is one of them.
    pub asked_first: usize,
    pub first: usize,
    /// Findings that are not there.
    pub wrong: usize,
    /// Findings of the same logs without the effect that are gone with it.
    pub gone: usize,
    /// Cases in which nothing is missing, or what no effect explains, and those in which that is
    /// said.
    pub to_be_said: usize,
    pub said: usize,
    /// Share of the error on unseen logs that is gone, of what one who is told would remove.
    pub closed: Vec<f64>,
    /// s
    pub seconds: Vec<f64>,
    /// Of findings: probability, and whether it is there.
    pub probabilities: Vec<(f64, bool)>,
}

/// Rows by condition, in the order in which they came.
#[derive(Debug, Default)]
pub struct Table(Vec<(String, Row)>);

impl Table {
    pub fn add(&mut self, condition: &str, row: Row) {
        match self.0.iter_mut().find(|(name, _)| name == condition) {
            Some((_, sum)) => sum.add(row),
            None => self.0.push((condition.into(), row)),
        }
    }
}

impl Row {
    pub fn add(&mut self, more: Self) {
        let pairs = [
            (&mut self.cases, more.cases),
            (&mut self.wanted, more.wanted),
            (&mut self.found, more.found),
            (&mut self.asked_first, more.asked_first),
            (&mut self.first, more.first),
            (&mut self.wrong, more.wrong),
            (&mut self.gone, more.gone),
            (&mut self.to_be_said, more.to_be_said),
            (&mut self.said, more.said),
        ];
        pairs.into_iter().for_each(|(sum, more)| *sum += more);
        self.closed.extend(more.closed);
        self.seconds.extend(more.seconds);
        self.probabilities.extend(more.probabilities);
    }

    /// Mean square of probabilities less what is so (Brier, Monthly Weather Review 78 (1950)).
    fn brier(&self) -> f64 {
        let miss = |(p, right): &(f64, bool)| (p - f64::from(u8::from(*right))).powi(2);
        self.probabilities.iter().map(miss).sum::<f64>() / self.probabilities.len() as f64
    }
}

fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).copied().unwrap_or(f64::NAN)
}

/// `3 of 4`, `-` of none
fn of([part, all]: [usize; 2]) -> String {
    if all == 0 { "-".into() } else { format!("{part} of {all}") }
}

fn number(value: f64, digits: usize) -> String {
    if value.is_nan() { "-".into() } else { format!("{value:.digits$}") }
}

impl fmt::Display for Table {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "| logs | cases | found | found first | not there, a case | gone, a case | said | \
             error closed, % | Brier | s |"
        )?;
        writeln!(f, "|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|")?;
        let mut all = Row::default();
        self.0.iter().for_each(|(_, row)| all.add(row.clone()));
        for (name, row) in
            self.0.iter().map(|(name, row)| (name.as_str(), row)).chain([("all", &all)])
        {
            writeln!(
                f,
                "| {name} | {} | {} | {} | {:.2} | {:.2} | {} | {} | {} | {:.1} |",
                row.cases,
                of([row.found, row.wanted]),
                of([row.first, row.asked_first]),
                row.wrong as f64 / row.cases as f64,
                row.gone as f64 / row.cases as f64,
                of([row.said, row.to_be_said]),
                number(100.0 * median(&row.closed), 0),
                number(row.brier(), 2),
                median(&row.seconds),
            )?;
        }
        writeln!(f, "\n| probability of a finding | findings | there |\n|---|---:|---:|")?;
        for bin in 0..5 {
            let inside = |p: f64| ((5.0 * p) as usize).min(4) == bin;
            let own: Vec<bool> = all
                .probabilities
                .iter()
                .filter(|(p, _)| inside(*p))
                .map(|(_, right)| *right)
                .collect();
            let right = own.iter().filter(|right| **right).count();
            writeln!(
                f,
                "| {:.1} to {:.1} | {} | {right} |",
                0.2 * bin as f64,
                0.2 * (bin + 1) as f64,
                own.len()
            )?;
        }
        Ok(())
    }
}
