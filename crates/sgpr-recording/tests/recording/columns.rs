//! Which column of a table is what.

use sgpr_recording::csv::{ColumnMap, Columns, ReadOptions};
use sgpr_recording::{IssueKind, PositionUnit, TimeUnit, TorqueUnit, Units, VelocityUnit};

use super::{assert_close, csv_error, message, names, read_csv, read_csv_with};

fn wanting(joints: &[&str]) -> ReadOptions {
    ReadOptions::default().with_joints(Some(names(joints)))
}

fn pattern(text: &str) -> Option<Columns> {
    Some(Columns::Pattern(text.into()))
}

#[test]
fn numbered_columns() {
    let log = read_csv("t,q_1,q_2,dq_1,dq_2,tau_1,tau_2\n0.5,1,2,3,4,5,6\n0.6,1,2,3,4,5,6\n");
    assert_eq!(log.joint_names(), ["joint_1", "joint_2"]);
    assert_eq!(log.time(), [500_000_000, 600_000_000]);
    assert_eq!(log.position()[..2], [1.0, 2.0]);
    assert_eq!(log.velocity().expect("logged")[..2], [3.0, 4.0]);
    assert_eq!(log.torque().expect("logged")[..2], [5.0, 6.0]);
    assert!(log.channels().is_empty());
}

#[test]
fn words_of_other_languages() {
    let german = "Zeit [s],Achse 1 Istposition [rad],Achse 2 Istposition [rad],Geschwindigkeit Achse 1,Geschwindigkeit Achse 2,\
                  Drehmoment_1 [Nm],Drehmoment_2 [Nm],Sollposition_1,Soll_Moment_2\n0,1,2,3,4,5,6,7,8\n";
    let french = "temps,position_axe_1,position_axe_2,vitesse_1,vitesse_2,couple_1,couple_2,consigne_position_1,x\n0,1,2,3,4,5,6,7,8\n";
    for text in [german, french] {
        let log = read_csv(text);
        assert_eq!(log.joint_names(), ["joint_1", "joint_2"]);
        assert_eq!(log.position(), [1.0, 2.0]);
        assert_eq!(log.velocity().expect("logged"), [3.0, 4.0]);
        assert_eq!(log.torque().expect("logged"), [5.0, 6.0]);
        assert_eq!(log.channels().len(), 2);
    }
}

#[test]
fn a_log_that_is_not_understood_names_its_patterns() {
    let text = "t,lage 1 (rad),lage 2 (rad),k2_a_1,k2_a_2,x\n0,1,2,3,4,5\n";
    let said = csv_error(text);
    assert!(
        said.contains("as a pattern (`lage {} (rad)`, `k2_a_{}`, where {} is the number"),
        "{said}"
    );
}

#[test]
fn velocity_and_torque_are_optional() {
    let log = read_csv("t,q_1\n0,1\n");
    assert!(log.velocity().is_none() && log.torque().is_none());
}

#[test]
fn commands_are_channels() {
    let log = read_csv("t_s,q1_rad,i1_A,i_des1_A,tau_des1_Nm,q_ref_rad\n0,1,2,3,4,5\n");
    assert!(log.torque().is_none());
    let channels: Vec<&str> = log.channels().iter().map(|channel| channel.name.as_str()).collect();
    assert_eq!(channels, ["i1_A", "i_des1_A", "tau_des1_Nm", "q_ref_rad"]);
    assert_eq!(log.channel("tau_des1_Nm").expect("kept").values, [4.0]);
}

#[test]
fn one_joint_without_number() {
    let log = read_csv("t_s,q_m,q_ref_m,vir_V,force_N,pulse_raw\n0,0.1,0.2,3,4,5\n");
    assert_eq!((log.position(), log.torque().expect("logged")), (&[0.1][..], &[4.0][..]));
    assert_eq!(log.channels().len(), 3);
}

#[test]
fn units_in_the_header_are_converted() {
    let log = read_csv(
        "time_ms,q1_deg,q2_mm,dq1_rpm,dq2_mm_s,tau1_mNm,tau2_kN\n1500,180,250,60,10,500,2\n",
    );
    assert_eq!(log.time(), [1_500_000_000]);
    assert_close(log.position(), &[std::f64::consts::PI, 0.25], 1e-15);
    assert_close(log.velocity().expect("logged"), &[std::f64::consts::TAU, 0.01], 1e-15);
    assert_close(log.torque().expect("logged"), &[0.5, 2000.0], 1e-12);
}

#[test]
fn units_of_the_caller_overrule() {
    let units = Units::default()
        .with_time(Some(TimeUnit::Microsecond))
        .with_position(Some(PositionUnit::Degree))
        .with_velocity(Some(VelocityUnit::DegreePerSecond))
        .with_torque(Some(TorqueUnit::MillinewtonMetre));
    let options = ReadOptions::default().with_units(units);
    let log =
        read_csv_with("t_s,q_1,dq1_rad_s,tau_1\n1000,180,90,500\n", &options).expect("readable");
    assert_eq!(log.time(), [1_000_000]);
    assert_close(log.position(), &[std::f64::consts::PI], 1e-15);
    assert_close(log.velocity().expect("logged"), &[std::f64::consts::FRAC_PI_2], 1e-15);
    assert_close(log.torque().expect("logged"), &[0.5], 1e-15);
}

#[test]
fn currents_become_torques_with_constants() {
    let options = ReadOptions::default().with_torque_constants(Some(vec![10.0, 2.0]));
    let log = read_csv_with("t,q1,q2,i1_A,i2_mA\n0,0,0,3,4000\n", &options).expect("readable");
    assert_eq!(log.torque().expect("computed"), [30.0, 8.0]);
    assert!(log.channels().is_empty());

    let text = "t,q1,q2,tau1,tau2\n0,0,0,1,1\n";
    assert!(
        message(read_csv_with(text, &options))
            .starts_with("log.csv: no torque column for `joint_1`, `joint_2`")
    );
    let wrong = ReadOptions::default().with_torque_constants(Some(vec![10.0]));
    let error = message(read_csv_with(text, &wrong));
    assert_eq!(
        error,
        "torque_constants: got 1 value for 2 joints: give one for each, in joint order"
    );
    let wrong = ReadOptions::default().with_torque_constants(Some(vec![10.0, f64::NAN]));
    assert!(message(read_csv_with(text, &wrong)).starts_with("torque_constants = NaN"));
}

#[test]
fn joints_by_name() {
    let options = wanting(&["elbow_joint", "shoulder_pan_joint"]);
    let text = "time,shoulder_pan_joint_position,elbow_joint_position,gripper_position,shoulder_pan_joint_velocity,\
                elbow_joint_velocity\n0,1,2,9,3,4\n";
    let log = read_csv_with(text, &options).expect("readable");
    assert_eq!(
        (log.position(), log.velocity().expect("logged")),
        (&[2.0, 1.0][..], &[4.0, 3.0][..])
    );
    assert_eq!(log.channel("gripper_position").expect("kept").values, [9.0]);
}

#[test]
fn joints_by_name_without_being_told() {
    let text = "time,/joint_states/left_s0/position,/joint_states/left_s1/position\n0,1,2\n";
    assert_eq!(read_csv(text).joint_names(), ["left_s0", "left_s1"]);
}

#[test]
fn a_joint_called_like_a_unit() {
    let log = read_csv("t,turn_position,lift_position,turn_torque,lift_torque\n0,1,2,3,4\n");
    assert_eq!(log.joint_names(), ["turn", "lift"]);
    assert_eq!(log.position(), [1.0, 2.0]);
    assert_eq!(log.torque(), Some(&[3.0, 4.0][..]));
}

/// The same, taking joints in the order of the numbers of columns.
fn wanting_in_order(joints: &[&str]) -> ReadOptions {
    wanting(joints).with_accept(vec![IssueKind::JointsByOrder])
}

#[test]
fn joints_by_number_in_order_are_confirmed() {
    let joints = ["shoulder_pan_joint", "elbow_joint"];
    let text = "t,q1,q2,q3\n0,1,2,3\n";
    assert_eq!(
        message(read_csv_with(text, &wanting(&joints))),
        "log.csv: no name tells which of the joints `shoulder_pan_joint`, `elbow_joint` is which \
         of the columns `q1`, `q2`, `q3`: if the columns are numbered in the order of the joints, \
         confirm it with `accept=[\"joints_by_order\"]`; else name them with `columns.position`"
    );
    let log = read_csv_with(text, &wanting_in_order(&joints)).expect("readable");
    assert_eq!(log.position(), [1.0, 2.0]);
    assert_eq!(log.joint_names(), ["shoulder_pan_joint", "elbow_joint"]);
    assert_eq!(
        log.notes(),
        ["joints by number: `shoulder_pan_joint`, `elbow_joint` are the columns `q1`, `q2`"]
    );
    assert_eq!(log.channel("q3").expect("kept").values, [3.0]);
    assert!(log.layout().expect("of a table").by_order);
    // A pattern of the caller numbers the joints, too.
    let columns = ColumnMap::default().with_torque(pattern("i{}"));
    let options = wanting(&["shoulder", "elbow"])
        .with_columns(columns)
        .with_torque_constants(Some(vec![10.0, 100.0]));
    let log = read_csv_with("t,q1,q2,i1,i2\n0,1,2,3,4\n", &options).expect("readable");
    assert_eq!(
        (log.position(), log.torque().expect("computed")),
        (&[1.0, 2.0][..], &[30.0, 400.0][..])
    );
}

#[test]
fn numbers_of_all_quantities_agree() {
    // The third joint slides; its force has another name.
    let text = "t,q1,q2,q3,q4,tau1,tau2,f3,tau4\n0,1,2,3,4,10,20,30,40\n";
    for options in [
        ReadOptions::default(),
        wanting_in_order(&["a", "b", "c", "d"]),
        wanting(&["j1", "j2", "j3", "j4"]),
    ] {
        let error = message(read_csv_with(text, &options));
        assert!(error.starts_with("log.csv: no torque column for"), "{error}");
    }
    let torque = Some(Columns::Names(names(&["tau1", "tau2", "f3", "tau4"])));
    let options = ReadOptions::default().with_columns(ColumnMap::default().with_torque(torque));
    let log = read_csv_with(text, &options).expect("told");
    assert_eq!(log.torque().expect("told"), [10.0, 20.0, 30.0, 40.0]);
    // One joint less than the numbers: the torque of the third is not that of the fourth.
    let error = message(read_csv_with(text, &wanting_in_order(&["a", "b", "c"])));
    assert!(error.starts_with("log.csv: no torque column for `c`"), "{error}");
    // Counted from zero and from one.
    let text = "t,q1,q2,tau0,tau1\n0,1,2,3,4\n";
    for options in [ReadOptions::default(), wanting(&["j1", "j2"])] {
        assert_eq!(
            message(read_csv_with(text, &options)),
            "log.csv: the torque columns `tau0`, `tau1` are numbered otherwise than the position \
             columns `q1`, `q2`: say which belong to which joint with `columns.torque`"
        );
    }
}

#[test]
fn a_unit_counts_whatever_else_the_name_says() {
    let half_turn = std::f64::consts::PI;
    for (name, options) in [
        ("robot/axis1/actual_angle_deg", pattern("robot/axis{}/actual_angle_deg")),
        ("A1_Istposition [deg]", pattern("A{}_Istposition [deg]")),
        ("A1_Istposition [°]", pattern("A{}_Istposition [°]")),
    ] {
        let columns = ColumnMap::default().with_position(options);
        let text = format!("t,{name}\n0,180\n");
        for joints in [None, Some(names(&["joint_1"])), Some(names(&["elbow"]))] {
            let options = ReadOptions::default().with_columns(columns.clone()).with_joints(joints);
            let log = read_csv_with(&text, &options).expect("readable");
            assert_close(log.position(), &[half_turn], 1e-15);
            assert!(log.layout().expect("of a table").to_string().contains("position in deg;"));
        }
    }
    let columns = ColumnMap::default().with_position(pattern("A{} [inc]"));
    let options = ReadOptions::default().with_columns(columns);
    assert_eq!(
        message(read_csv_with("t,A1 [inc]\n0,4096\n", &options)),
        "log.csv: column `A1 [inc]`: `inc` is no known unit of position: give the unit with \
         `units.position`"
    );
}

#[test]
fn currents_are_no_torques() {
    let columns = ColumnMap::default().with_torque(pattern("drive{}_cur_A"));
    let options = ReadOptions::default().with_columns(columns);
    let text = "t,q1,drive1_cur_A\n0,1,2\n";
    assert_eq!(
        message(read_csv_with(text, &options)),
        "log.csv: the columns `drive1_cur_A` hold motor currents in A, not torques: give \
         `torque_constants`, N·m per A; or, if they are torques, their unit with `units.torque`"
    );
    let units = Units::default().with_torque(Some(TorqueUnit::NewtonMetre));
    assert_eq!(
        read_csv_with(text, &options.with_units(units)).expect("told").torque(),
        Some(&[2.0][..])
    );
    let log = read_csv("t,q1,i1_A\n0,1,2\n");
    assert!(
        log.notes()[0].starts_with(
            "there is no torque, but motor currents (`i1_A`): give `torque_constants`"
        )
    );
}

#[test]
fn torque_constants_by_name() {
    let text = "t,wrist_position,elbow_position,wrist_current,elbow_current\n0,1,2,10,20\n";
    let listed = ReadOptions::default().with_torque_constants(Some(vec![3.0, 5.0]));
    let error = message(read_csv_with(text, &listed));
    assert_eq!(
        error,
        "log.csv: torque constants come in the order of the robot's joints, but only the log tells \
         the joints here (`wrist`, `elbow`): name the joints in order with `joints`, or the joint \
         of each constant (wrist=...)"
    );
    let constants = vec![("elbow".into(), 3.0), ("wrist".into(), 5.0)];
    let named = ReadOptions::default().with_named_torque_constants(constants);
    assert_eq!(read_csv_with(text, &named).expect("told").torque(), Some(&[50.0, 60.0][..]));
    let robot = named.clone().with_joints(Some(names(&["elbow", "wrist"])));
    assert_eq!(read_csv_with(text, &robot).expect("told").torque(), Some(&[60.0, 50.0][..]));
    let robot = listed.with_joints(Some(names(&["elbow", "wrist"])));
    let log = read_csv_with(text, &robot).expect("ordered");
    assert_eq!(log.torque(), Some(&[60.0, 50.0][..]));
    assert_eq!(
        log.layout().expect("of a table").to_string(),
        "elbow = elbow_position, elbow_current * 3; wrist = wrist_position, wrist_current * 5; \
         position in rad (m) (assumed), torque in A times the torque constant (assumed); time t in \
         s (assumed)"
    );
    let lacking = ReadOptions::default().with_named_torque_constants(vec![("elbw".into(), 3.0)]);
    assert!(
        message(read_csv_with(text, &lacking))
            .contains("there is no joint `elbw` (did you mean `elbow`?)")
    );
    let lacking = ReadOptions::default().with_named_torque_constants(vec![("elbow".into(), 3.0)]);
    assert_eq!(
        message(read_csv_with(text, &lacking)),
        "log.csv: there is no torque constant for joint `wrist`"
    );
}

#[test]
fn joints_by_the_number_in_their_name() {
    let log = read_csv_with("t,q1,q2,q3\n0,1,2,3\n", &wanting(&["panda_joint3", "panda_joint2"]))
        .expect("readable");
    assert_eq!(log.position(), [3.0, 2.0]);
}

#[test]
fn numbers_from_zero() {
    let text = "timestamp actual_q_0 actual_q_1 target_q_0\n0 1 2 9\n";
    let log = read_csv_with(text, &wanting(&["joint_1", "joint_2"])).expect("readable");
    assert_eq!(log.position(), [1.0, 2.0]);
    let error = message(read_csv_with(text, &wanting(&["joint_1"])));
    assert_eq!(
        error,
        "log.csv: the columns `actual_q_0`, `actual_q_1` count joints from 0 and there are more of \
         them than the joints `joint_1`: say which are meant with `columns.position`"
    );
}

#[test]
fn columns_named_by_the_caller() {
    let columns = ColumnMap::default()
        .with_time(Some("clock".into()))
        .with_position(pattern("enc{}"))
        .with_velocity(Some(Columns::Names(names(&["speed a", "speed b"]))))
        .with_torque(pattern("{name}:load"));
    let options = wanting(&["a", "b"]).with_columns(columns);
    let text = "clock,enc1,enc2,speed a,speed b,a:load,b:load,q1,q2\n1,1,2,3,4,5,6,7,8\n";
    let log = read_csv_with(text, &options).expect("readable");
    assert_eq!(log.position(), [1.0, 2.0]);
    assert_eq!(log.velocity().expect("named"), [3.0, 4.0]);
    assert_eq!(log.torque().expect("named"), [5.0, 6.0]);
    assert_eq!(log.channels().len(), 2);
}

#[test]
fn a_pattern_tells_the_number_of_joints() {
    let columns =
        ColumnMap::default().with_position(pattern("enc{}")).with_torque(pattern("load{}"));
    let options = ReadOptions::default().with_columns(columns);
    let log = read_csv_with("t,enc1,enc2,load1,load2\n0,1,2,3,4\n", &options).expect("readable");
    assert_eq!((log.dof(), log.torque().expect("named")), (2, &[3.0, 4.0][..]));
}

#[test]
fn a_named_column_that_is_not_there() {
    let columns = ColumnMap::default().with_torque(pattern("i{}_A"));
    let options = ReadOptions::default().with_columns(columns);
    assert_eq!(
        message(read_csv_with("t,q1,I1_A\n0,1,2\n", &options)),
        "log.csv: there is no column `i1_A` (did you mean `I1_A`?); the columns are `t`, `q1`, \
         `I1_A`"
    );
}

#[test]
fn a_pattern_for_several_joints_varies() {
    let columns = ColumnMap::default().with_position(pattern("enc"));
    let options = wanting(&["a", "b"]).with_columns(columns);
    let error = message(read_csv_with("t,enc\n0,1\n", &options));
    assert!(
        error.contains("columns.position = enc: a pattern for several joints holds {}"),
        "{error}"
    );
}

#[test]
fn several_columns_for_one_joint() {
    assert_eq!(
        csv_error("t,q1_rad,q1_deg\n0,1,57\n"),
        "log.csv: the position of joint `joint_1` could be any of `q1_rad`, `q1_deg`: say which \
         with `columns.position`"
    );
}

#[test]
fn a_joint_without_column() {
    let error = csv_error("t,q1,q2,tau1\n0,1,2,3\n");
    assert!(
        error.starts_with(
            "log.csv: no torque column for `joint_2`; the columns are `t`, `q1`, `q2`, `tau1`;"
        ),
        "{error}"
    );
    let error = message(read_csv_with("t,a_position\n0,1\n", &wanting(&["a", "b"])));
    assert!(error.starts_with("log.csv: no position column for `b`"), "{error}");
    let error = message(read_csv_with("t,q1\n0,1\n", &wanting(&["a", "b"])));
    assert!(error.starts_with("log.csv: no position column for `b`"), "{error}");
    // A gap in the numbers is the joint without column, whatever the joints are called.
    let gap = "t,q_1,q_3\n0,1,3\n";
    for (joints, missing) in
        [(["joint_1", "joint_2", "joint_3"], "joint_2"), (["a", "b", "c"], "b")]
    {
        let error = message(read_csv_with(gap, &wanting(&joints)));
        assert!(
            error.starts_with(&format!("log.csv: no position column for `{missing}`;")),
            "{error}"
        );
    }
    // Positions and torques that are counted in ways that no joint tells.
    let error = message(read_csv_with("t,q_4,q_9\n0,1,3\n", &wanting(&["a", "b", "c"])));
    assert!(error.starts_with(
        "log.csv: got 2 columns of position (`q_4`, `q_9`) for 3 joints (`a`, `b`, `c`): say"
    ));
    let columns = ColumnMap::default().with_position(Some(Columns::Names(names(&["x", "y"]))));
    let options = ReadOptions::default().with_columns(columns);
    let error = message(read_csv_with("t,x,y,tau_3,tau_4\n0,1,2,3,4\n", &options));
    assert!(error.contains(
        "no name tells which of the joints `joint_1`, `joint_2` is which of the columns `tau_3`"
    ));
    let log = read_csv_with("t,q1\n0,1\n", &wanting(&["a"])).expect("one joint, one column");
    assert!(!log.layout().expect("of a table").by_order);
}

#[test]
fn no_positions_at_all() {
    let error = csv_error("t,x,y\n0,1,2\n");
    assert!(
        error.starts_with("log.csv: no joint positions among the columns `t`, `x`, `y`; say which"),
        "{error}"
    );
}

#[test]
fn joints_of_other_names_are_told() {
    let text = "t,axis_a_position,axis_b_position\n0,1,2\n";
    assert_eq!(
        message(read_csv_with(text, &wanting(&["shoulder", "elbow"]))),
        "log.csv: the log has the joints `axis_a`, `axis_b`, not `shoulder`, `elbow`: name its \
         columns in the order of the robot with `columns.position`, such as \
         position=axis_a_position,axis_b_position, and those of velocity and torque alike"
    );
}

#[test]
fn wanted_joints_must_be_distinct() {
    assert!(
        message(read_csv_with("t,q1\n0,1\n", &wanting(&["a", "a"])))
            .contains("the joint `a` occurs twice")
    );
    assert!(message(read_csv_with("t,q1\n0,1\n", &wanting(&[]))).contains("at least one joint"));
}

#[test]
fn a_column_name_that_occurs_twice() {
    assert_eq!(csv_error("t,q1,q1\n0,1,2\n"), "log.csv: the column name `q1` occurs twice");
}
