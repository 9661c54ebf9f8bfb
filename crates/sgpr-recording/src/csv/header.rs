//! What the name of a column says: `q1_rad` is the position of joint 1 in rad.
//!
//! A column is understood only if every word of its name is: `tau_des1_Nm` holds a word (`des`)
//! that could mean anything but a measurement, so it is no torque.

use super::quantity::{Label, Meaning, Quantity, StatedUnit};
use super::words::Words;
use crate::TimeUnit;

/// Longer names, in bytes, are not looked at.
const LONGEST_NAME: usize = 200;

/// The joint quantity that `name` speaks of, if all its words are understood. `joints` are the
/// joints wanted, if known.
pub(super) fn meaning(name: &str, joints: Option<&[String]>) -> Option<Meaning> {
    if name.len() > LONGEST_NAME {
        return None;
    }
    let words = Words::of(name);
    let of_known_joint = joints.unwrap_or_default().iter().filter_map(|joint| {
        let place = words.find(joint)?;
        let (quantity, unit) = words.without(place).quantity_alone()?;
        // Of `arm` and `upper_arm` the longer name is meant.
        Some((joint.len(), Meaning { quantity, label: Label::Name(joint.clone()), unit }))
    });
    let known = of_known_joint.max_by_key(|(length, _)| *length).map(|(_, meaning)| meaning);
    known.or_else(|| words.quantity_and_label(joints.is_none()))
}

/// Which quantity an array with a column per joint holds, by its name: `time`, `position`,
/// `velocity`, `torque` or `current`. `None` if a word of it is not understood: `tau_ext` is no
/// torque.
///
/// # Examples
/// ```
/// use sgpr_recording::csv::quantity_of_array;
/// assert_eq!(quantity_of_array("q_deg"), Some("position"));
/// assert_eq!(quantity_of_array("time [ms]"), Some("time"));
/// assert_eq!(quantity_of_array("q_des"), None);
/// ```
pub fn quantity_of_array(name: &str) -> Option<&'static str> {
    if name.len() > LONGEST_NAME {
        return None;
    }
    if time_unit(name).is_some() {
        return Some("time");
    }
    let (quantity, _) = Words::of(name).quantity_alone()?;
    Some(if quantity == Quantity::Current { "current" } else { quantity.name() })
}

/// The unit in which a name ends whose other words are not understood: `axis3/angle_deg`,
/// `A1_Istposition [°]`.
pub(super) fn unit_at_end(name: &str, quantity: Quantity) -> Option<StatedUnit> {
    if name.len() > LONGEST_NAME {
        return None;
    }
    match bracketed(name) {
        Some(text) => quantity.unit(text),
        None => Words::of(name).unit_at_end(quantity),
    }
}

/// What stands in brackets at the end of a name, unless it is the number of a joint.
pub(super) fn bracketed(name: &str) -> Option<&str> {
    let name = name.trim_end();
    let open = match name.chars().last()? {
        ']' => '[',
        ')' => '(',
        _ => return None,
    };
    let text = name[name.rfind(open)? + 1..name.len() - 1].trim();
    (!text.is_empty() && !text.chars().all(|letter| letter.is_ascii_digit())).then_some(text)
}

/// The word or sign at the end of a name that says that numbers are a share of something:
/// `torque1 [%]`, `trq_1_percent`.
pub(super) fn ratio(name: &str) -> Option<&str> {
    let end = name.trim_end_matches([']', ')', ' ']);
    ["%", "‰", "percent", "pct"].into_iter().find(|sign| end.ends_with(sign))
}

/// Whether the words of a text in brackets are no unit but say that this is the measurement of a
/// joint.
pub(super) fn says_nothing(text: &str) -> bool {
    Words::of(text).says_nothing()
}

/// The unit of a time column, or `None` if `name` is none. The unit is `None` if the name does not
/// say it.
pub(super) fn time_unit(name: &str) -> Option<Option<TimeUnit>> {
    let words = Words::of(name);
    let lower = words.lower();
    let is_time = |words: &[&str]| {
        matches!(
            words,
            ["t" | "time"
                | "timestamp"
                | "stamp"
                | "elapsed"
                | "clock"
                | "zeit"
                | "zeitstempel"
                | "temps"
                | "tiempo"]
                | ["time", "stamp"]
                | ["header", "stamp"]
                | ["elapsed" | "log" | "ros" | "sim" | "header", "time"]
        )
    };
    if is_time(&lower) {
        return Some(None);
    }
    let (last, rest) = lower.split_last()?;
    let unit = last.parse().ok()?;
    is_time(rest).then_some(Some(unit))
}

/// What comes before `sec` and `nanosec` in the two columns of a ROS time stamp, e.g.
/// `header.stamp.`.
pub(super) fn stamp_part(name: &str) -> Option<(&str, TimeUnit)> {
    let parts = [
        ("nanosec", TimeUnit::Nanosecond),
        ("nsec", TimeUnit::Nanosecond),
        ("sec", TimeUnit::Second),
    ];
    let (suffix, unit) = parts.into_iter().find(|(suffix, _)| name.ends_with(suffix))?;
    let stem = &name[..name.len() - suffix.len()];
    (stem.is_empty() || stem.ends_with(['.', '_', '/', ' '])).then_some((stem, unit))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(name: &str) -> Option<(Quantity, Label, Option<f64>)> {
        let factor = |unit: StatedUnit| unit.factor;
        meaning(name, None)
            .map(|meaning| (meaning.quantity, meaning.label, meaning.unit.map(factor)))
    }

    #[test]
    fn units_behind_words_that_are_not_understood() {
        let unit = |name, quantity| unit_at_end(name, quantity).map(|unit| unit.name);
        assert_eq!(unit("robot/axis3/actual_angle_deg", Quantity::Position), Some("deg"));
        assert_eq!(unit("A1_Istposition [°]", Quantity::Position), Some("deg"));
        assert_eq!(unit("A1_Istposition (mm)", Quantity::Position), Some("mm"));
        assert_eq!(unit("A1_Drehzahl [1/min]", Quantity::Velocity), Some("rpm"));
        assert_eq!(unit("drive 2 speed_deg_s", Quantity::Velocity), Some("deg/s"));
        assert_eq!(unit("drive_2_mNm", Quantity::Torque), Some("mNm"));
        assert_eq!(unit("drive_2_cur_A", Quantity::Current), Some("A"));
        // Names of joints, numbers of joints, other quantities.
        assert_eq!(unit("encoder turn", Quantity::Position), None);
        assert_eq!(unit("encoder[3]", Quantity::Position), None);
        assert_eq!(unit("encoder_Nm", Quantity::Position), None);
        assert_eq!(bracketed("counts [inc]"), Some("inc"));
        assert_eq!(bracketed("position[0]"), None);
    }

    #[test]
    fn numbered_columns() {
        use Quantity::*;
        let si = Some(1.0);
        for (name, quantity, number, factor) in [
            ("q_1", Position, 1, None),
            ("q1_rad", Position, 1, si),
            ("q12", Position, 12, None),
            ("dq1_rad_s", Velocity, 1, si),
            ("tau1_Nm", Torque, 1, si),
            ("tau_J_3", Torque, 3, None),
            ("i2_A", Current, 2, si),
            ("effort_2_A", Current, 2, si),
            ("joint_1_position", Position, 1, None),
            ("joint_1_effort", Torque, 1, None),
            ("joint_1/velocity", Velocity, 1, None),
            ("position.joint_4", Position, 4, None),
            ("/joint_states/position[0]", Position, 0, None),
            ("pos_1", Position, 1, None),
            ("vel_1", Velocity, 1, None),
            ("qd_1", Velocity, 1, None),
            ("actual_qd_0", Velocity, 0, None),
            ("torque_6", Torque, 6, None),
            ("q1 [rad]", Position, 1, si),
            ("dq1 (rad/s)", Velocity, 1, si),
            ("tau 1 [N·m]", Torque, 1, si),
            ("pos_mm_2", Position, 2, Some(1e-3)),
            ("tau_mNm_2", Torque, 2, Some(1e-3)),
            ("current_3_mA", Current, 3, Some(1e-3)),
        ] {
            assert_eq!(read(name), Some((quantity, Label::Number(number), factor)), "{name}");
        }
        let degrees = read("vel_2_deg_s").expect("understood").2.expect("unit");
        assert!((degrees - std::f64::consts::PI / 180.0).abs() < 1e-15);
        assert!(read("q1_°").expect("understood").2.expect("unit") < 0.02);
        assert!(
            (read("speed3_rpm").expect("understood").2.expect("unit") - 0.104_719_755).abs() < 1e-8
        );
    }

    #[test]
    fn one_joint_needs_no_number() {
        assert_eq!(read("q_m"), Some((Quantity::Position, Label::Unnamed, Some(1.0))));
        assert_eq!(read("force_N"), Some((Quantity::Torque, Label::Unnamed, Some(1.0))));
        assert_eq!(read("velocity"), Some((Quantity::Velocity, Label::Unnamed, None)));
    }

    #[test]
    fn what_is_not_a_measurement_is_not_understood() {
        for name in [
            "tau_des1_Nm",
            "i_des1_A",
            "q_ref_m",
            "vir_V",
            "pulse_raw",
            "tau1_raw",
            "ddq1_rad_s2",
            "q_d_1",
            "tau_ext_1",
            "target_q_0",
            "q1_Nm",
            "temperature_1",
            "position_error_2",
            "joint_1_target_position",
            "tcp_position_x",
            "motor_torque_1",
            "joint_2_command_effort",
            "q1_2",
            "",
        ] {
            assert_eq!(read(name), None, "{name}");
        }
    }

    #[test]
    fn named_joints() {
        let name = |name: &str| Label::Name(name.into());
        assert_eq!(
            read("shoulder_pan_joint_position"),
            Some((Quantity::Position, name("shoulder_pan_joint"), None))
        );
        assert_eq!(
            read("/joint_states/elbow/effort"),
            Some((Quantity::Torque, name("elbow"), None))
        );
        assert_eq!(read("velocity.left_s0"), Some((Quantity::Velocity, name("left_s0"), None)));
        // Which joint `a_b` of `a_b_q` is must be told.
        assert_eq!(read("a_b_q"), None);
        let joints = ["a_b".to_string(), "b".to_string()];
        assert_eq!(meaning("a_b_q", Some(&joints)).expect("told").label, name("a_b"));
        // Names are compared word by word.
        let joints = ["joint_1".to_string(), "joint_10".to_string()];
        assert_eq!(
            meaning("joint_10_pos_deg", Some(&joints)).expect("told").label,
            name("joint_10")
        );
        // Other names than those wanted are not joints.
        assert_eq!(meaning("gripper_position", Some(&joints)), None);
    }

    #[test]
    fn time_columns() {
        for name in [
            "t",
            "time",
            "timestamp",
            "Time",
            "stamp",
            "__time",
            "header.stamp",
            "log_time",
            "Zeit",
        ] {
            assert_eq!(time_unit(name), Some(None), "{name}");
        }
        assert_eq!(time_unit("t_s"), Some(Some(TimeUnit::Second)));
        assert_eq!(time_unit("time [ms]"), Some(Some(TimeUnit::Millisecond)));
        assert_eq!(time_unit("time_ns"), Some(Some(TimeUnit::Nanosecond)));
        assert_eq!(time_unit("timestamp_us"), Some(Some(TimeUnit::Microsecond)));
        assert_eq!(time_unit("time_constant"), None);
        assert_eq!(time_unit("t_1"), None);
        assert_eq!(stamp_part("header.stamp.sec"), Some(("header.stamp.", TimeUnit::Second)));
        assert_eq!(
            stamp_part("header.stamp.nanosec"),
            Some(("header.stamp.", TimeUnit::Nanosecond))
        );
    }
}
