//! Base parameters as formulas in the letters of the literature: `XX2R = XX2 - YY2 + 0.1865 M3`.

use super::BaseParameters;
use super::base_parameters::{NEGLIGIBLE, significant};
use crate::spatial::{PARAMETERS_PER_LINK, STANDARD_PARAMETER_NAMES};

/// Letters of the ten parameters of a link (Khalil, Dombre (2002)), in the order of
/// [`STANDARD_PARAMETER_NAMES`].
const LETTERS: [&str; PARAMETERS_PER_LINK] =
    ["M", "MX", "MY", "MZ", "XX", "XY", "YY", "XZ", "YZ", "ZZ"];

impl BaseParameters {
    /// Base parameter `base` as a formula, links and joints numbered from one in the order of the
    /// robot's joints: what is regrouped has an R behind its name. Factors (SI) come from the
    /// geometry; those below 1e-6 are left out.
    ///
    /// # Examples
    /// ```
    /// use sgpr_core::identification::{BaseParameters, ParameterSet};
    /// let robot = sgpr_core::robot::two_link();
    /// let set = ParameterSet::new(&robot, &["rotor_inertia"]).unwrap();
    /// let base = BaseParameters::by_recursion(&robot, &set);
    /// assert_eq!(base.formula(2), "ZZ1R = ZZ1 + M2 + Ia1");
    /// ```
    pub fn formula(&self, base: usize) -> String {
        let kept = self.symbol(self.independent()[base]);
        let terms = self.combination(base).iter().filter(|(_, factor)| factor.abs() > NEGLIGIBLE);
        let mut right = kept.clone();
        for &(parameter, factor) in terms {
            right += if factor < 0.0 { " - " } else { " + " };
            if (factor.abs() - 1.0).abs() > NEGLIGIBLE {
                right += &significant(factor.abs());
                right.push(' ');
            }
            right += &self.symbol(parameter);
        }
        if right == kept { kept } else { format!("{kept}R = {right}") }
    }

    /// All formulas.
    pub fn formulas(&self) -> Vec<String> {
        (0..self.rank()).map(|base| self.formula(base)).collect()
    }

    /// `YY2` for `joint_2.Iyy`, where joint_2 is the second joint; `Fv2` for `joint_2.Fv`.
    fn symbol(&self, parameter: usize) -> String {
        let split = |name: &str| {
            name.rsplit_once('.').map(|(joint, own)| (joint.to_string(), own.to_string()))
        };
        let names = self.parameter_names();
        let Some((joint, own)) = split(&names[parameter]) else { return names[parameter].clone() };
        let first_of_link = (0..names.len()).step_by(PARAMETERS_PER_LINK);
        let Some(link) = first_of_link
            .clone()
            .position(|k| split(&names[k]).is_some_and(|(other, _)| other == joint))
        else {
            return names[parameter].clone();
        };
        let letters =
            STANDARD_PARAMETER_NAMES.iter().position(|name| *name == own).map(|k| LETTERS[k]);
        let symbol = letters.unwrap_or(&own);
        let between = if symbol.ends_with(|c: char| c.is_ascii_digit()) { "_" } else { "" };
        format!("{symbol}{between}{}", link + 1)
    }
}
