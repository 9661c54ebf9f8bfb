//! Parameters of bodies: near the data, inside the limits, and a reason where there are none.

use sgpr_core::identification::{
    Consistency, ConsistentParameters, DEVIATIONS, Distance, IdentificationError, LeftOut,
    LinkBounds, Method, ParameterBounds, PhysicalBounds, Prior, Region,
};
use sgpr_core::spatial::LinkInertia;

use crate::arm::{Experiment, largest_difference};
use crate::noise::Noise;

fn solve(
    consistency: &Consistency,
    noise: f64,
) -> (Experiment, Result<ConsistentParameters, IdentificationError>) {
    let experiment = Experiment::new(1500);
    let motion = experiment.run(&experiment.truth);
    let mut random = Noise(7);
    let tau: Vec<f64> = motion.tau.iter().map(|tau| tau + noise * random.normal()).collect();
    let estimate = experiment.estimate(&Method::Wls, &motion, &tau).expect("good data");
    let mut nominal = experiment.truth.clone();
    nominal[experiment.set.inertial()..].fill(0.0);
    let torque = [20.0, 5.0];
    let found = consistency.solve(
        &experiment.robot,
        &experiment.set,
        &experiment.base,
        &estimate.whitened,
        &nominal,
        &torque,
    );
    (experiment, found)
}

fn of_distance(distance: Distance) -> Consistency {
    Consistency::default()
        .with_prior(Prior::default().with_distance(distance).with_relative_deviation(1.0))
}

#[test]
fn a_consistent_arm_is_near_the_data_and_made_of_bodies() {
    for distance in [Distance::Entropic, Distance::Euclidean] {
        let (experiment, found) = solve(&of_distance(distance), 0.5);
        let found = found.expect("an arm");
        // Point masses lie on the border of what bodies are, and noise pushes the estimate over it.
        let error = largest_difference(&found.base, &experiment.expected());
        assert!(error < 0.1, "{distance:?}: {error}");
        assert!(
            largest_difference(&experiment.base.combine(&found.parameters), &found.base) < 1e-12
        );
        for (link, values) in found.links.iter().zip(found.parameters.as_chunks::<10>().0) {
            assert!(link.smallest_eigenvalue > 0.0 && link.relative_eigenvalue > 0.0, "{link:?}");
            let body = LinkInertia::from_standard_parameters(values);
            assert!(
                (body.smallest_pseudo_inertia_eigenvalue() - link.smallest_eigenvalue).abs()
                    < 1e-12
            );
            let [a, b, c] = link.principal_moments;
            assert!(a > 0.0 && c <= a + b + 1e-12, "{link:?}");
        }
        let effects = &found.parameters[experiment.set.inertial()..];
        assert!(effects.iter().all(|value| *value >= -1e-6), "{effects:?}");
        assert!(found.cost < 3.0, "{}", found.cost);
    }
}

#[test]
fn data_without_noise_are_no_trouble_to_the_solver() {
    for noise in [0.0, 1e-9, 1e-6] {
        let (experiment, found) = solve(&Consistency::default(), noise);
        let found = found.expect("an arm");
        let error = largest_difference(&found.base, &experiment.expected());
        // Point masses lie on the border, from which the program keeps a millionth.
        assert!(error < 1e-4, "{noise}: {error}");
    }
}

#[test]
fn a_robot_file_that_says_nothing_of_friction_does_not_draw_it_to_zero() {
    for distance in [Distance::Entropic, Distance::Euclidean] {
        let prior = Prior::default().with_distance(distance).with_relative_deviation(0.01);
        let (experiment, found) = solve(&Consistency::default().with_prior(prior), 0.2);
        let found = found.expect("an arm");
        let effects = experiment.set.inertial()..;
        for ((value, truth), name) in found.parameters[effects.clone()]
            .iter()
            .zip(&experiment.truth[effects.clone()])
            .zip(&experiment.set.names()[effects])
        {
            // The right bodies determine the rotors too, which lie beside them.
            assert!((value / truth - 1.0).abs() < 0.15, "{distance:?}: {name} {value} {truth}");
        }
    }
}

#[test]
fn limits_are_kept_and_named_where_they_matter() {
    let region = Region::Ellipsoid { centre: [0.5, 0.0, 0.0], half_axes: [0.05, 0.1, 0.1] };
    let bounds = PhysicalBounds::default()
        .with_links(vec![
            LinkBounds::new("joint_1").with_mass(Some([0.5, 3.0])),
            LinkBounds::new("joint_2").with_mass(Some([1.4, 1.5])).with_centre(Some(region)),
        ])
        .with_total_mass(Some([1.0, 4.0]))
        .with_parameters(vec![ParameterBounds::new("joint_1.Fv").with_lowest(Some(0.6))]);
    let (_, found) = solve(&of_distance(Distance::Entropic).with_bounds(bounds), 0.2);
    let found = found.expect("an arm");
    assert!((1.4 - 1e-4..1.5 + 1e-4).contains(&found.links[1].mass), "{}", found.links[1].mass);
    assert!((found.links[1].centre[0] - 0.5).abs() < 0.0501);
    assert!(found.active.iter().any(|name| name.contains("joint_1.Fv")), "{:?}", found.active);
}

#[test]
fn limits_that_contradict_each_other_are_named_and_no_others() {
    let link = |joint: &str, mass| LinkBounds::new(joint).with_mass(Some(mass));
    let bounds = PhysicalBounds::default()
        .with_links(vec![link("joint_1", [2.0, 9.0]), link("joint_2", [1.0, 9.0])])
        .with_total_mass(Some([0.0, 2.5]));
    let (_, found) = solve(&Consistency::default().with_bounds(bounds), 0.1);
    let message = found.expect_err("no arm").to_string();
    for word in
        ["`joint_1` at least 2 kg", "`joint_2` at least 1 kg", "all links together at most 2.5 kg"]
    {
        assert!(message.contains(word), "{message}");
    }
    assert!(!message.contains("at most 9"), "{message}");

    let bounds = PhysicalBounds::default().with_links(vec![link("joint_2", [2.0, 1.0])]);
    let (_, found) = solve(&Consistency::default().with_bounds(bounds), 0.1);
    let message = found.expect_err("no arm").to_string();
    assert!(message.contains("at least 2 kg") && message.contains("at most 1 kg"), "{message}");
}

#[test]
fn limits_on_what_is_not_there_are_refused() {
    let bad = |bounds: PhysicalBounds| {
        let (_, found) = solve(&Consistency::default().with_bounds(bounds), 0.1);
        found.expect_err("refused").to_string()
    };
    let links = vec![LinkBounds::new("elbow")];
    assert!(bad(PhysicalBounds::default().with_links(links)).contains("elbow"));
    let parameters = vec![ParameterBounds::new("joint_1.Q").with_lowest(Some(0.0))];
    assert!(bad(PhysicalBounds::default().with_parameters(parameters)).contains("joint_1.Q"));
    assert!(
        bad(PhysicalBounds::default().with_total_mass(Some([f64::NAN, 1.0]))).contains("number")
    );
}

#[test]
fn the_limit_that_is_wrong_is_the_dearest() {
    // Friction of joint 1 is 0.5 N·m·s/rad; a limit far above it costs most of what the limits cost
    // together.
    let parameters = vec![ParameterBounds::new("joint_1.Fv").with_lowest(Some(1.5))];
    let consistency = of_distance(Distance::Euclidean)
        .with_bounds(PhysicalBounds::default().with_parameters(parameters));
    let experiment = Experiment::new(1500);
    let motion = experiment.run(&experiment.truth);
    let mut random = Noise(7);
    let tau: Vec<f64> = motion.tau.iter().map(|tau| tau + 0.2 * random.normal()).collect();
    let estimate = experiment.estimate(&Method::Wls, &motion, &tau).expect("good data");
    let mut nominal = experiment.truth.clone();
    nominal[experiment.set.inertial()..].fill(0.0);
    let (robot, set, base) = (&experiment.robot, &experiment.set, &experiment.base);
    let costs = consistency
        .costs(robot, set, base, &estimate.whitened, &nominal, &[20.0, 5.0])
        .expect("an arm");
    let prices = costs.prices;
    assert!(prices[0].limit.contains("joint_1.Fv at least 1.5"), "{prices:?}");
    assert!(prices[0].share > 0.9, "{prices:?}");
    assert!(prices.iter().all(|price| (0.0..=1.0).contains(&price.share)));
    assert_eq!(costs.stages[0].limit, prices[0].limit);
    assert!(costs.stages[0].residual_percent < 0.1 * costs.residual_percent, "{:?}", costs.stages);
    // Limits that the data keep anyway cost nothing worth a name.
    let costs =
        Consistency::default().costs(robot, set, base, &estimate.whitened, &nominal, &[20.0, 5.0]);
    assert!(costs.expect("an arm").prices.iter().all(|price| !price.limit.contains("joint_1.Fv")));
}

#[test]
fn a_robot_file_that_is_right_helps_to_predict() {
    let experiment = Experiment::new(600);
    let motion = experiment.run(&experiment.truth);
    let mut random = Noise(9);
    let tau: Vec<f64> = motion.tau.iter().map(|tau| tau + 3.0 * random.normal()).collect();
    let n = experiment.robot.dof();
    let folds: Vec<_> = (0..3)
        .map(|fold| {
            let part = fold * 200 * n..(fold + 1) * 200 * n;
            let samples = sgpr_core::dynamics::Samples {
                q: &motion.q[part.clone()],
                dq: &motion.dq[part.clone()],
                ddq: &motion.ddq[part.clone()],
            };
            let mut observation = sgpr_core::identification::Observation::new(
                &experiment.robot,
                &experiment.set,
                &experiment.base,
            );
            observation.add_samples(samples, &tau[part], None).expect("good data");
            observation.factors()
        })
        .collect();
    let parts = LeftOut::new(&folds, |_| 3.0, experiment.base.rank());
    let scores = of_distance(Distance::Euclidean)
        .cross_validate(
            &experiment.robot,
            &experiment.set,
            &experiment.base,
            &parts,
            &experiment.truth,
            &[20.0, 5.0],
        )
        .expect("an arm");
    assert_eq!(scores.iter().map(|(deviation, _)| *deviation).collect::<Vec<_>>(), DEVIATIONS);
    // Errors are in units of the noise, which was 3 N·m.
    assert!(scores.iter().all(|(_, error)| (error - 1.0).abs() < 0.1), "{scores:?}");
    assert!(scores[0].1 < scores[DEVIATIONS.len() - 1].1, "{scores:?}");
}
