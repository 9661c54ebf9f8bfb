//! Dynamics of one sample or of many; the numbers are made while the interpreter is free.

use numpy::PyArrayDyn;
use pyo3::prelude::*;
use sgpr_core::dynamics::{self as core, BatchWorkspace, Workspace};
use sgpr_core::robot::{Frame, Robot as CoreRobot};
use sgpr_core::spatial::{PARAMETERS_PER_LINK, Pose};

use crate::convert::{Samples, zeros};
use crate::detached::detached;
use crate::errors::IntoPyErr;
use crate::robot::Robot;

type Array<'py> = Bound<'py, PyArrayDyn<f64>>;

/// Motion of many samples as the core takes it.
pub fn motion<'a>(samples: &'a [Samples<'_>; 3]) -> core::Samples<'a> {
    let [q, dq, ddq] = samples;
    core::Samples { q: q.values(), dq: dq.values(), ddq: ddq.values() }
}

#[pymethods]
impl Robot {
    /// Inverse dynamics: the torque that a motion needs, tau = M(q) ddq + C(q, dq) dq + g(q).
    ///
    /// Parameters
    /// ----------
    /// q, dq, ddq : array of shape (N, n) or (n,)
    ///     rad, rad/s, rad/s² (m for prismatic joints).
    ///
    /// Returns
    /// -------
    /// array of the shape of q
    ///     N·m (N).
    ///
    /// Examples
    /// --------
    /// >>> robot = sgpr.robots.two_link()
    /// >>> robot.inverse_dynamics(np.zeros((100, 2)), np.zeros((100, 2)), np.zeros((100, 2))).shape
    /// (100, 2)
    fn inverse_dynamics<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        dq: &Bound<'py, PyAny>,
        ddq: &Bound<'py, PyAny>,
    ) -> PyResult<Array<'py>> {
        let robot = &self.inner;
        let n = robot.dof();
        let samples = Samples::together([("q", q), ("dq", dq), ("ddq", ddq)], n)?;
        let mut tau = zeros(&[samples[0].count(), n])?;
        let motion = motion(&samples);
        detached(py, || core::rnea_batch(robot, &mut BatchWorkspace::new(robot), motion, &mut tau));
        samples[0].result(py, &[n], tau)
    }

    /// Forward dynamics: the acceleration that a torque makes, ddq = M(q)⁻¹ (tau - C(q, dq) dq -
    /// g(q)).
    ///
    /// Parameters
    /// ----------
    /// q, dq, tau : array of shape (N, n) or (n,)
    ///     rad, rad/s, N·m (m, m/s, N for prismatic joints).
    ///
    /// Returns
    /// -------
    /// array of the shape of q
    ///     rad/s² (m/s²); not finite where a joint moves no inertia.
    ///
    /// Examples
    /// --------
    /// >>> robot = sgpr.robots.two_link()
    /// >>> q, dq = [0.3, -0.2], [1.0, 0.5]
    /// >>> ddq = robot.forward_dynamics(q, dq, [2.0, 1.0])
    /// >>> robot.inverse_dynamics(q, dq, ddq)
    /// array([2., 1.])
    fn forward_dynamics<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        dq: &Bound<'py, PyAny>,
        tau: &Bound<'py, PyAny>,
    ) -> PyResult<Array<'py>> {
        self.each(
            py,
            [("q", q), ("dq", dq), ("tau", tau)],
            &[self.dof()],
            |robot, ws, [q, dq, tau], ddq| {
                ddq.copy_from_slice(core::forward_dynamics(robot, ws, q, dq, tau));
            },
        )
    }

    /// Mass matrix M(q), (N, n, n) or (n, n), kg·m² (kg·m, kg).
    ///
    /// Examples
    /// --------
    /// >>> sgpr.robots.two_link().mass_matrix([0.0, 0.0])
    /// array([[2.5 , 0.75],
    ///        [0.75, 0.25]])
    fn mass_matrix<'py>(&self, py: Python<'py>, q: &Bound<'py, PyAny>) -> PyResult<Array<'py>> {
        self.each(py, [("q", q)], &[self.dof(), self.dof()], |robot, ws, [q], matrix| {
            matrix.copy_from_slice(core::mass_matrix(robot, ws, q));
        })
    }

    /// Bias forces C(q, dq) dq + g(q): the torque of a motion without acceleration, N·m (N), of the
    /// shape of q.
    ///
    /// Examples
    /// --------
    /// >>> robot = sgpr.robots.two_link()
    /// >>> bool(np.allclose(robot.bias_forces([0.3, 0.1], [0.0, 0.0]), robot.gravity_torque([0.3, 0.1])))
    /// True
    fn bias_forces<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        dq: &Bound<'py, PyAny>,
    ) -> PyResult<Array<'py>> {
        self.each(py, [("q", q), ("dq", dq)], &[self.dof()], |robot, ws, [q, dq], tau| {
            tau.copy_from_slice(core::bias_forces(robot, ws, q, dq));
        })
    }

    /// Gravity torque g(q): what holds the arm still, N·m (N), of the shape of q.
    ///
    /// Examples
    /// --------
    /// >>> sgpr.robots.two_link().gravity_torque([0.0, 0.0])
    /// array([19.62 ,  4.905])
    fn gravity_torque<'py>(&self, py: Python<'py>, q: &Bound<'py, PyAny>) -> PyResult<Array<'py>> {
        self.each(py, [("q", q)], &[self.dof()], |robot, ws, [q], tau| {
            tau.copy_from_slice(core::gravity_torque(robot, ws, q));
        })
    }

    /// Regressor Y(q, dq, ddq), so that tau = Y @ standard_parameters.
    ///
    /// Returns
    /// -------
    /// array of shape (N, n, 10 n), or (n, 10 n) for one sample
    ///     N·m per unit of the parameter; `reshape(-1, 10 * n)` stacks the samples.
    ///
    /// Examples
    /// --------
    /// >>> robot = sgpr.robots.two_link()
    /// >>> q = dq = ddq = np.linspace(-1, 1, 10).reshape(5, 2)
    /// >>> Y = robot.regressor(q, dq, ddq)
    /// >>> Y.shape
    /// (5, 2, 20)
    /// >>> bool(np.allclose(Y @ robot.standard_parameters, robot.inverse_dynamics(q, dq, ddq)))
    /// True
    fn regressor<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        dq: &Bound<'py, PyAny>,
        ddq: &Bound<'py, PyAny>,
    ) -> PyResult<Array<'py>> {
        let robot = &self.inner;
        let (n, columns) = (robot.dof(), PARAMETERS_PER_LINK * robot.dof());
        let samples = Samples::together([("q", q), ("dq", dq), ("ddq", ddq)], n)?;
        let mut matrix = zeros(&[samples[0].count(), n, columns])?;
        let motion = motion(&samples);
        detached(py, || {
            core::regressor_batch(robot, &mut BatchWorkspace::new(robot), motion, &mut matrix)
        });
        samples[0].result(py, &[n, columns], matrix)
    }

    /// Pose of a frame in the base frame, as homogeneous matrix, (N, 4, 4) or (4, 4).
    ///
    /// Parameters
    /// ----------
    /// q : array of shape (N, n) or (n,)
    ///     rad (m for prismatic joints).
    /// frame : str, optional
    ///     One of `frames`. By default the last of them that moves with the last joint.
    ///
    /// Examples
    /// --------
    /// >>> sgpr.robots.two_link().forward_kinematics([0.0, 0.0])[:3, 3]  # both links stretched out
    /// array([2., 0., 0.])
    #[pyo3(signature = (q, frame=None))]
    fn forward_kinematics<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        frame: Option<&str>,
    ) -> PyResult<Array<'py>> {
        let frame = self.frame_or_tip(frame)?;
        self.each(py, [("q", q)], &[4, 4], |robot, ws, [q], matrix| {
            let pose = core::frame_pose(robot, ws, q, &frame).to_matrix4();
            matrix.copy_from_slice(pose.as_flattened());
        })
    }

    /// Jacobian of a frame, (N, 6, n) or (6, n): velocity of its origin (rows 0-2) and its angular
    /// velocity (rows 3-5), in base axes, per joint velocity.
    ///
    /// Parameters
    /// ----------
    /// q : array of shape (N, n) or (n,)
    ///     rad (m for prismatic joints).
    /// frame : str, optional
    ///     One of `frames`. By default the last of them that moves with the last joint.
    ///
    /// Examples
    /// --------
    /// >>> sgpr.robots.two_link().jacobian([0.0, 0.0])[1]  # sideways motion of the tip
    /// array([2., 1.])
    #[pyo3(signature = (q, frame=None))]
    fn jacobian<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        frame: Option<&str>,
    ) -> PyResult<Array<'py>> {
        let frame = self.frame_or_tip(frame)?;
        self.each(py, [("q", q)], &[6, self.dof()], |robot, ws, [q], matrix| {
            matrix.copy_from_slice(core::jacobian(robot, ws, q, &frame));
        })
    }

    /// Kinetic energy dqᵀ M(q) dq / 2, (N,) or a number, J.
    ///
    /// Examples
    /// --------
    /// >>> float(sgpr.robots.two_link().kinetic_energy([0.0, 0.0], [1.0, 0.0]))
    /// 1.25
    fn kinetic_energy<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        dq: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let energy = self.each(py, [("q", q), ("dq", dq)], &[], |robot, ws, [q, dq], energy| {
            energy[0] = core::kinetic_energy(robot, ws, q, dq);
        })?;
        number_or_array(energy)
    }

    /// Potential energy of the moving links, zero at the base origin, (N,) or a number, J.
    ///
    /// Examples
    /// --------
    /// >>> up = sgpr.robots.two_link().potential_energy([np.pi / 2, 0.0])  # 1 kg at 0.5 m and at 1.5 m
    /// >>> round(float(up), 6)
    /// 19.62
    fn potential_energy<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let energy = self.each(py, [("q", q)], &[], |robot, ws, [q], energy| {
            energy[0] = core::potential_energy(robot, ws, q);
        })?;
        number_or_array(energy)
    }
}

impl Robot {
    /// `one(robot, workspace, inputs, result)` for every sample; a result has the shape `item`.
    fn each<'py, const K: usize>(
        &self,
        py: Python<'py>,
        inputs: [(&str, &Bound<'py, PyAny>); K],
        item: &[usize],
        one: impl Fn(&CoreRobot, &mut Workspace, [&[f64]; K], &mut [f64]) + Send + Sync,
    ) -> PyResult<Array<'py>> {
        let robot = &self.inner;
        let n = robot.dof();
        let samples = Samples::together(inputs, n)?;
        let width: usize = item.iter().product();
        let mut results = zeros(&[samples[0].count(), width])?;
        let values: [&[f64]; K] = std::array::from_fn(|input| samples[input].values());
        detached(py, || {
            let mut ws = Workspace::new(robot);
            for (k, result) in results.chunks_exact_mut(width).enumerate() {
                one(robot, &mut ws, values.map(|rows| &rows[k * n..(k + 1) * n]), result);
            }
        });
        samples[0].result(py, item, results)
    }

    /// The frame `name`, or the last that moves with the last joint, or that joint's own.
    fn frame_or_tip(&self, name: Option<&str>) -> PyResult<Frame> {
        if let Some(name) = name {
            return self.inner.frame(name).cloned().map_err(IntoPyErr::into_py_err);
        }
        let last = Some(self.dof() - 1);
        let tip = self.inner.frames().iter().rev().find(|frame| frame.joint == last).cloned();
        Ok(tip.unwrap_or(Frame { name: "tip".into(), joint: last, pose: Pose::IDENTITY }))
    }
}

/// The number in an array without axes; any other array as it is.
fn number_or_array(array: Array<'_>) -> PyResult<Bound<'_, PyAny>> {
    array.get_item(pyo3::types::PyTuple::empty(array.py()))
}
