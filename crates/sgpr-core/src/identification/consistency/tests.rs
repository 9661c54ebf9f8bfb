use super::*;

const BODY: [f64; 10] = [2.0, 0.3, -0.2, 0.5, 0.6, 0.01, 0.7, -0.02, 0.03, 0.4];

#[test]
fn entries_of_the_pseudo_inertia_are_those_of_the_body() {
    let link = LinkInertia::from_standard_parameters(&BODY);
    let rows = link.pseudo_inertia();
    for row in 0..4 {
        for column in row..4 {
            let value = pseudo_inertia_entry(0, row, column).value(&BODY);
            assert!((value - rows[row][column]).abs() < 1e-15, "{row} {column}");
        }
    }
    let matrix = nalgebra::Matrix4::from_fn(|row, column| rows[row][column]);
    for (a, b) in parameters_of(&matrix).iter().zip(BODY) {
        assert!((a - b).abs() < 1e-15);
    }
}

#[test]
fn numbers_without_a_square_are_no_program() {
    for cost in [1e160, f64::NAN, f64::INFINITY] {
        let mut program = ConicProgram::default();
        let x = program.variables(10);
        require_body(&mut program, x);
        program.add_cost(&pseudo_inertia_entry(x, 0, 0).scaled(cost));
        assert!(
            matches!(program.solve().status, ConicStatus::Failed(reason) if reason.contains("a \
                 number of"))
        );
    }
    // Of no inverse, whatever its size.
    let mut program = ConicProgram::default();
    let x = program.variables(10);
    add_divergence(&mut program, x, &nalgebra::Matrix4::zeros(), 1.0);
    assert!(matches!(program.solve().status, ConicStatus::Failed(_)));
}

#[test]
fn the_divergence_is_that_of_its_definition() {
    // min over P of <G, P> + w (tr(P0⁻¹ P) - ln det P) is at P = (P0⁻¹ + G / w)⁻¹.
    let size = LinkSize { mass: 1.0, length: 1.0 };
    let (nominal, mended) = size.definite(&LinkInertia::from_standard_parameters(&BODY));
    assert!(!mended);
    let pull = nalgebra::Matrix4::new(
        0.4, 0.1, 0.0, 0.05, 0.1, 0.7, -0.2, 0.0, 0.0, -0.2, 0.5, 0.1, 0.05, 0.0, 0.1, 0.3,
    );
    let weight = 0.7;
    let mut program = ConicProgram::default();
    program.variables(10);
    for row in 0..4 {
        for column in 0..4 {
            let entry = pseudo_inertia_entry(0, row.min(column), row.max(column));
            program.add_cost(&entry.scaled(pull[(row, column)]));
        }
    }
    add_divergence(&mut program, 0, &nominal, weight);
    let outcome = program.solve();
    assert_eq!(outcome.status, ConicStatus::Solved);
    let expected =
        (nominal.try_inverse().expect("definite") + pull / weight).try_inverse().expect("definite");
    for (a, b) in outcome.x.iter().zip(parameters_of(&expected)) {
        // The divergence is flat at its minimum: a gap of 1e-8 is 1e-4 in the parameters.
        assert!((a - b).abs() < 1e-3, "{a} {b}");
    }
}

#[test]
fn no_link_is_heavier_than_the_whole_arm() {
    // Two links of 1 kg, 1 m apart: the file's arm weighs 2 kg, one with 9.80665 N·m at that reach
    // up to 10 kg.
    let robot = crate::robot::two_link();
    let set = ParameterSet::new(&robot, &[] as &[&str]).expect("no effect");
    let (base, nominal) = (BaseParameters::new(&robot, &set), robot.standard_parameters());
    let scale = vec![1.0; set.len()];
    let reach = robot.joints()[1].placement.translation.norm();
    let limits = |bounds: &PhysicalBounds, torque: [f64; 2]| {
        let found = bounds::masses(bounds, &robot, &base, &nominal, &torque, &scale);
        // Where the limit on the last link binds.
        let margin = |mass: f64| {
            let mut x = vec![0.0; set.len()];
            x[PARAMETERS_PER_LINK] = mass;
            found.last().map_or(f64::NAN, |bound| bound.margin(&x))
        };
        (found.len(), 1.0 / (margin(0.0) - margin(1.0)))
    };
    let free = PhysicalBounds::default();
    let (count, most) = limits(&free, [1e-3, 1e-4]);
    assert!(
        count == 2 && (most - nominal[0] - nominal[PARAMETERS_PER_LINK]).abs() < 1e-9,
        "{count} {most}"
    );
    let (_, most) = limits(&free, [9.806_65 * reach, 1.0]);
    assert!((most - 10.0).abs() < 1e-9, "{most}");
    let own = PhysicalBounds { total_mass: Some([1.0, 9.0]), ..free };
    assert_eq!(limits(&own, [1.0; 2]).0, 0, "what the user says of masses goes before");
}

#[test]
fn an_inertia_that_no_body_has_is_mended_and_a_rod_is_not() {
    let size = LinkSize { mass: 1.0, length: 0.1 };
    let impossible = [1.0, 0.0, 0.0, 0.0, 0.01, 0.0, 0.01, 0.0, 0.0, 0.03];
    let rod = [1.0, 0.0, 0.0, 0.0, 0.01, 0.0, 0.01, 0.0, 0.0, 0.0];
    for (parameters, expected) in [(impossible, true), (rod, false)] {
        let (matrix, mended) = size.definite(&LinkInertia::from_standard_parameters(&parameters));
        assert_eq!(mended, expected);
        assert!(matrix.symmetric_eigenvalues().min() > 9e-4);
    }
}

/// A load is a body of one sign, its mass within reach.
#[test]
fn the_nearest_load_is_a_body_within_reach() {
    let sure = Mat::<f64>::identity(10, 10);
    let cube = [2.0, 0.1, 0.0, 0.2, 0.05, 0.0, 0.05, -0.01, 0.0, 0.03];
    for sign in [1.0, -1.0] {
        let load = cube.map(|x| sign * x);
        let found = nearest_load(&load, &sure, 1.0).expect("a body");
        assert!(found.distance2 < 1e-6, "{}", found.distance2);
        let differs = found
            .parameters
            .iter()
            .zip(load)
            .map(|(own, load)| (own - load).abs())
            .fold(0.0, f64::max);
        assert!(differs < 1e-3, "{differs}");
    }
    // 26 g whose inertia would have to lie more than five metres away.
    let far = [0.026, 0.0, 0.0, 0.0, 0.8, 0.0, 0.7, 0.0, 0.0, 0.5];
    let anywhere = nearest_load(&far, &sure, f64::INFINITY).expect("a body");
    let within = nearest_load(&far, &sure, 0.8).expect("a body");
    assert!(
        anywhere.distance2 < 1e-6 && within.distance2 > 0.3,
        "{} {}",
        anywhere.distance2,
        within.distance2
    );
    let [mass, .., xx, _, yy, _, _, zz] = within.parameters;
    assert!(0.5 * (xx + yy + zz) <= 0.8 * 0.8 * mass + 1e-6, "{:?}", within.parameters);
    // Inertia of one sign and mass of the other: neither taken up nor put down.
    let mixed = nearest_load(&[-1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 1.0], &sure, 0.8)
        .expect("a body");
    assert!(mixed.distance2 > 0.9, "{}", mixed.distance2);
}
