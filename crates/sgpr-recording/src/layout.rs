use std::fmt;

use serde::{Deserialize, Serialize};

/// Which column of a log became what, and in which unit it was read.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Layout {
    /// The time, in words: `t in s`, `250 Hz, counted`.
    pub time: String,
    /// Joint by joint, in the order of the joints.
    pub joints: Vec<JointLayout>,
    /// Whether the joints were given columns in the order of their numbers, as no name told.
    pub by_order: bool,
}

/// The columns of one joint.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct JointLayout {
    /// Its name.
    pub joint: String,
    /// Position.
    pub position: ColumnLayout,
    /// Velocity, if it was logged.
    pub velocity: Option<ColumnLayout>,
    /// Torque, if it was logged.
    pub torque: Option<ColumnLayout>,
}

/// A column and how it was read.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct ColumnLayout {
    /// Its name in the log.
    pub column: String,
    /// Its unit: as stated by the caller, its name or the line of units, or else what was assumed.
    pub unit: String,
    /// Whether somebody stated the unit.
    pub stated: bool,
    /// N·m per A (N per A) by which a current became a torque.
    pub torque_constant: Option<f64>,
}

impl JointLayout {
    fn columns(&self) -> impl Iterator<Item = (&'static str, &ColumnLayout)> {
        let arrays = [
            ("position", Some(&self.position)),
            ("velocity", self.velocity.as_ref()),
            ("torque", self.torque.as_ref()),
        ];
        arrays.into_iter().filter_map(|(quantity, column)| Some((quantity, column?)))
    }

    fn column(&self, quantity: &str) -> Option<&ColumnLayout> {
        self.columns().find(|(name, _)| *name == quantity).map(|(_, column)| column)
    }
}

impl Layout {
    /// The same for the joints at these places, in this order.
    pub(super) fn select(&self, places: &[usize]) -> Self {
        Self {
            joints: places.iter().map(|&place| self.joints[place].clone()).collect(),
            ..self.clone()
        }
    }

    /// The same with other names for the joints.
    pub(super) fn renamed(mut self, names: &[String]) -> Self {
        for (joint, name) in self.joints.iter_mut().zip(names) {
            joint.joint.clone_from(name);
        }
        self
    }

    /// `position in rad`, if all joints agree.
    fn common_unit(&self, quantity: &str) -> Option<String> {
        let mut columns = self.joints.iter().filter_map(|joint| joint.column(quantity));
        let first = columns.next()?;
        let same =
            |other: &ColumnLayout| (&other.unit, other.stated) == (&first.unit, first.stated);
        let current =
            if first.torque_constant.is_some() { " times the torque constant" } else { "" };
        let how = if first.stated { "" } else { " (assumed)" };
        columns.all(same).then(|| format!("{quantity} in {}{current}{how}", first.unit))
    }
}

impl fmt::Display for Layout {
    /// One line:
    /// `joint_1 = q_1, dq_1, tau_1; joint_2 = ...; position in rad (m) (assumed), ...; time t in s`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let quantities = ["position", "velocity", "torque"];
        let common = quantities.map(|quantity| self.common_unit(quantity));
        for joint in &self.joints {
            let shown = joint.columns().map(|(quantity, column)| {
                let place =
                    quantities.iter().position(|name| *name == quantity).expect("one of them");
                let constant = column
                    .torque_constant
                    .map_or(String::new(), |constant| format!(" * {constant}"));
                let unit = match (&common[place], column.stated) {
                    (Some(_), _) => String::new(),
                    (None, true) => format!(" [{}]", column.unit),
                    (None, false) => format!(" [{}, assumed]", column.unit),
                };
                format!("{}{unit}{constant}", column.column)
            });
            write!(f, "{} = {}; ", joint.joint, shown.collect::<Vec<_>>().join(", "))?;
        }
        let units: Vec<String> = common.into_iter().flatten().collect();
        if !units.is_empty() {
            write!(f, "{}; ", units.join(", "))?;
        }
        write!(f, "time {}", self.time)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn column(name: &str, unit: &str, stated: bool) -> ColumnLayout {
        ColumnLayout { column: name.into(), unit: unit.into(), stated, torque_constant: None }
    }

    #[test]
    fn one_line_says_which_column_is_what() {
        let joint = |number: usize, unit: &str, stated| JointLayout {
            joint: format!("joint_{number}"),
            position: column(&format!("q_{number}"), unit, stated),
            velocity: None,
            torque: Some(ColumnLayout {
                torque_constant: Some(9.5),
                ..column(&format!("i_{number}"), "A", true)
            }),
        };
        let layout = |joints| Layout { time: "t in s".into(), joints, by_order: false };
        assert_eq!(
            layout(vec![joint(1, "deg", true), joint(2, "deg", true)]).to_string(),
            "joint_1 = q_1, i_1 * 9.5; joint_2 = q_2, i_2 * 9.5; position in deg, torque in A \
             times the torque constant; time t in s"
        );
        assert_eq!(
            layout(vec![joint(1, "deg", true), joint(2, "rad (m)", false)]).to_string(),
            "joint_1 = q_1 [deg], i_1 * 9.5; joint_2 = q_2 [rad (m), assumed], i_2 * 9.5; \
             torque in A times the torque constant; time t in s"
        );
    }
}
