//! Robots from Denavit-Hartenberg tables. Only this file knows them.

use alloc::string::String;
use alloc::vec::Vec;

use super::{Frame, Joint, JointKind, Limits, Robot, RobotError};
use crate::spatial::{LinkInertia, Matrix3, Pose, Vector3};

/// Which of the two conventions a table follows; they look alike and mean different robots.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DhConvention {
    /// Denavit and Hartenberg (1955), Paul (1981): frame i at the far end of link i,
    /// T(i-1, i) = Rz(theta) Tz(d) Tx(a) Rx(alpha).
    Standard,
    /// Craig (1986), Khalil and Kleinfinger (1986): frame i on the axis of joint i,
    /// T(i-1, i) = Rx(alpha) Tx(a) Rz(theta) Tz(d), where alpha and a are those of the link before.
    Modified,
}

/// One row of the table: a joint and its link.
///
/// Mass, centre of mass and inertia are given in the DH frame of the row, the inertia about the
/// centre of mass, as published tables do.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct DhRow {
    /// Link length, m.
    pub a: f64,
    /// Link twist, rad.
    pub alpha: f64,
    /// Link offset, m; for a prismatic joint its value at position zero.
    pub d: f64,
    /// Joint angle at position zero, rad.
    pub theta: f64,
    /// Whether the joint slides along z instead of turning about it.
    pub prismatic: bool,
    /// Mass, kg.
    pub mass: f64,
    /// Centre of mass, m.
    pub centre_of_mass: [f64; 3],
    /// Inertia about the centre of mass, kg·m².
    pub inertia: [[f64; 3]; 3],
    /// Limits.
    pub limits: Limits,
}

impl DhRow {
    setters! {
        with_a(a: f64),
        with_alpha(alpha: f64),
        with_d(d: f64),
        with_theta(theta: f64),
        with_prismatic(prismatic: bool),
        with_mass(mass: f64),
        with_centre_of_mass(centre_of_mass: [f64; 3]),
        with_inertia(inertia: [[f64; 3]; 3]),
        with_limits(limits: Limits),
    }
}

impl DhRow {
    /// A revolute joint without inertia.
    pub fn revolute(a: f64, alpha: f64, d: f64, theta: f64) -> Self {
        Self {
            a,
            alpha,
            d,
            theta,
            prismatic: false,
            mass: 0.0,
            centre_of_mass: [0.0; 3],
            inertia: [[0.0; 3]; 3],
            limits: Limits::default(),
        }
    }

    /// A prismatic joint without inertia.
    pub fn prismatic(a: f64, alpha: f64, d: f64, theta: f64) -> Self {
        Self { prismatic: true, ..Self::revolute(a, alpha, d, theta) }
    }

    /// The row with this body.
    #[must_use]
    pub fn with_body(
        mut self,
        mass: f64,
        centre_of_mass: [f64; 3],
        inertia: [[f64; 3]; 3],
    ) -> Self {
        (self.mass, self.centre_of_mass, self.inertia) = (mass, centre_of_mass, inertia);
        self
    }

    /// Rx(alpha) Tx(a); rotation and translation share the axis and commute.
    fn along_x(&self) -> Pose {
        Pose::new(
            Matrix3::rotation(Vector3::new(1.0, 0.0, 0.0), self.alpha),
            Vector3::new(self.a, 0.0, 0.0),
        )
    }

    /// Rz(theta) Tz(d) without the joint's own motion.
    fn along_z(&self) -> Pose {
        Pose::new(
            Matrix3::rotation(Vector3::new(0.0, 0.0, 1.0), self.theta),
            Vector3::new(0.0, 0.0, self.d),
        )
    }
}

impl Robot {
    /// A serial robot from its DH table.
    ///
    /// Joint axes are the z axes. The link frame of this crate is the joint frame: for
    /// [`DhConvention::Modified`] the DH frame of the row, for [`DhConvention::Standard`] the frame
    /// before `Tz(d) Tx(a) Rx(alpha)`; use [`DhConvention::link_frame`] to convert parameters. A
    /// frame `tool` marks the last DH frame.
    ///
    /// `names` are the joints' names; `joint_1`, `joint_2`, ... if `None`.
    ///
    /// # Errors
    /// If the table is empty or a number is not finite, a mass negative, or `names` has another
    /// length.
    pub fn from_dh(
        name: &str,
        convention: DhConvention,
        rows: &[DhRow],
        names: Option<&[String]>,
        gravity: Vector3<f64>,
    ) -> Result<Self, RobotError> {
        if let Some(names) = names.filter(|names| names.len() != rows.len()) {
            return Err(RobotError::NameCount { expected: rows.len(), found: names.len() });
        }
        let mut joints = Vec::with_capacity(rows.len());
        let mut links = Vec::with_capacity(rows.len());
        // From the link frame of the last joint to where its DH row ends.
        let mut end_of_row = Pose::IDENTITY;
        for (index, row) in rows.iter().enumerate() {
            let before = match convention {
                DhConvention::Standard => {
                    Pose::from_rotation(Matrix3::rotation(Vector3::new(0.0, 0.0, 1.0), row.theta))
                }
                DhConvention::Modified => row.along_x() * row.along_z(),
            };
            let joint_name =
                names.map_or_else(|| format!("joint_{}", index + 1), |names| names[index].clone());
            let centre = Vector3::from(row.centre_of_mass);
            let body =
                LinkInertia::from_centre_of_mass(row.mass, centre, Matrix3::from_rows(row.inertia));
            let link_frame = convention.link_frame(row);
            joints.push(Joint {
                name: joint_name,
                kind: if row.prismatic { JointKind::Prismatic } else { JointKind::Revolute },
                parent: index.checked_sub(1),
                placement: end_of_row * before,
                axis: Vector3::new(0.0, 0.0, 1.0),
                limits: row.limits,
                damping: 0.0,
                friction: 0.0,
            });
            links.push(body.expressed_in(&link_frame));
            end_of_row = link_frame;
        }
        let tool =
            Frame { name: "tool".into(), joint: rows.len().checked_sub(1), pose: end_of_row };
        Self::new(name, joints, links, vec![tool], gravity)
    }
}

impl DhConvention {
    /// Pose of the row's DH frame in the link frame of this crate; express a body given in the DH
    /// frame with it.
    pub fn link_frame(self, row: &DhRow) -> Pose {
        match self {
            Self::Standard => Pose::from_translation(Vector3::new(0.0, 0.0, row.d)) * row.along_x(),
            Self::Modified => Pose::IDENTITY,
        }
    }
}
