//! From a robot file and logs to a torque model, and the model in a control loop.
//!
//! ```text
//! cargo run --release --package sgpr-core --example identify -- data/demo
//! ```
//!
//! The folder holds `robot.urdf`, three logs for training and one for the test, named as below.

use std::error::Error;
use std::path::Path;

use sgpr_core::model::{IdentifyOptions, Predictor, TorqueModel, compare, identify};
use sgpr_core::recording::{Recording, csv, inspect};
use sgpr_core::robot::{Robot, UrdfOptions};

fn main() -> Result<(), Box<dyn Error>> {
    let folder = std::env::args()
        .nth(1)
        .ok_or("name the folder of robot.urdf and its logs, such as data/demo")?;
    let data = Path::new(&folder);
    let robot = Robot::from_urdf(data.join("robot.urdf"), &UrdfOptions::default())?;
    let read = |name: &str| csv::read(data.join(name), &csv::ReadOptions::default());
    let train = ["train_1.csv.gz", "train_2.csv.gz", "train_3.csv.gz"].map(read);
    let train: Vec<Recording> = train.into_iter().collect::<Result<_, _>>()?;
    let test = [read("test.csv.gz")?];
    for issue in train.iter().flat_map(inspect) {
        println!("{}", issue.message);
    }

    let effects =
        ["viscous_friction", "coulomb_friction", "rotor_inertia"].map(String::from).to_vec();
    let options = IdentifyOptions::default().with_effects(effects);
    let (model, report) = identify(&robot, &train, &options, &())?;
    report.warnings.iter().for_each(|warning| println!("{warning}"));
    for parameter in model.base_parameters().iter().take(5) {
        let deviation = parameter.standard_deviation.unwrap_or(f64::NAN);
        println!(
            "{:<14} {:9.4} ± {deviation:.4} {}",
            parameter.name, parameter.value, parameter.unit
        );
    }

    // On a log that the fit has not seen: the robot file against the identified model.
    let before = compare(&TorqueModel::nominal(&robot), &test, model.processing())?;
    let after = compare(&model, &test, None)?;
    for (before, after) in before.joints.iter().zip(&after.joints) {
        println!("{}: {:7.3} -> {:.3} {}", after.joint, before.rmse, after.rmse, after.unit);
    }

    // In a control loop: no allocation, no lock.
    let mut predictor = Predictor::new(&model);
    let tau = predictor.torque(&[0.1; 6], &[0.2; 6], &[0.0; 6]);
    println!("feed-forward torque: {tau:.2?}");
    Ok(())
}
