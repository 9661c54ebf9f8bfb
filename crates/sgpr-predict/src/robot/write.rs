//! A robot with other inertias, back in a file.

use std::collections::HashMap;
use std::fmt::Write;
use std::io::Write as _;
use std::ops::Range;
use std::path::Path;

use quick_xml::Reader;
use quick_xml::events::{BytesStart, Event};

use super::urdf::{UrdfOptions, inertias_at_urdf_links};
use super::{JointKind, Robot, RobotError};
use crate::spatial::{LinkInertia, Matrix3};

/// What a joint needs beside its link, for [`Robot::to_mjcf`]; zero for nothing.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct JointDynamics {
    /// Rotor inertia at the joint, kg·m² (kg).
    pub rotor_inertia: f64,
    /// Viscous friction, N·m·s/rad (N·s/m).
    pub viscous_friction: f64,
    /// Coulomb friction, N·m (N).
    pub coulomb_friction: f64,
}

impl JointDynamics {
    setters! {
        with_rotor_inertia(rotor_inertia: f64),
        with_viscous_friction(viscous_friction: f64),
        with_coulomb_friction(coulomb_friction: f64),
    }
}

impl Robot {
    /// The URDF `text` with the inertias of this robot and the friction of its joints, everything
    /// else as it was, comments and order too.
    ///
    /// `text` and `options` are those that the robot was read with. The body behind a moving joint
    /// goes into the link that the joint carries; links fixed to it lose their `<inertial>`, since
    /// it counts there already. Links behind locked joints keep theirs, and what they contribute is
    /// taken off. `<dynamics>` changes where damping or friction of a joint is not that of `text`.
    ///
    /// # Errors
    /// If `text` is not the URDF of this robot, or a link is no body: URDF has no place for a first
    /// moment without mass.
    pub fn write_into_urdf(
        &self,
        text: &str,
        origin: &str,
        options: &UrdfOptions,
    ) -> Result<String, RobotError> {
        let malformed = |message| RobotError::Malformed { path: origin.into(), message };
        // Before its tags are looked at: it refuses those that take for ever.
        let read = Robot::from_urdf_text(text, origin, options)?;
        let mut elements = Vec::new();
        let mut links = spans(text, "link", "inertial").map_err(malformed)?;
        for (link, body) in inertias_at_urdf_links(self, text, origin, options)? {
            let element = body.map_or(Ok(String::new()), |body| inertial_element(&link, &body))?;
            elements.extend(links.remove(&link).map(|span| (span, element)));
        }
        let mut joints = spans(text, "joint", "dynamics").map_err(malformed)?;
        for (new, old) in self.joints().iter().zip(read.joints()) {
            if (new.damping, new.friction) != (old.damping, old.friction) {
                let element = format!(
                    "<dynamics damping=\"{}\" friction=\"{}\"/>",
                    new.damping, new.friction
                );
                elements.extend(joints.remove(&new.name).map(|span| (span, element)));
            }
        }
        elements.sort_by_key(|(span, _)| span.replace.start);
        let mut written = String::with_capacity(text.len() + 200 * elements.len());
        let mut from = 0;
        for (span, element) in elements {
            written += &text[from..span.replace.start];
            from = span.replace.end;
            match (span.shape, element.as_str()) {
                (TagShape::Element, element) => written += element,
                (_, "") => written += &text[span.replace.clone()],
                (TagShape::OpenTag, element) => {
                    let _ = write!(written, "{}\n    {element}", &text[span.replace.clone()]);
                }
                (TagShape::EmptyTag, element) => {
                    let open = text[span.replace.clone()]
                        .trim_end_matches('>')
                        .trim_end_matches('/')
                        .trim_end();
                    let _ = write!(written, "{open}>\n    {element}\n  </{}>", span.outer);
                }
            }
        }
        written += &text[from..];
        Ok(written)
    }

    /// [`Self::write_into_urdf`] from file to file; the new file is complete or not there.
    ///
    /// # Errors
    /// If a file cannot be read or written, and as [`Self::write_into_urdf`].
    pub fn write_urdf(
        &self,
        source: impl AsRef<Path>,
        path: impl AsRef<Path>,
        options: &UrdfOptions,
    ) -> Result<(), RobotError> {
        let (source, path) = (source.as_ref(), path.as_ref());
        let name = |path: &Path| path.display().to_string();
        let text = std::fs::read_to_string(source)
            .map_err(|error| RobotError::Unreadable { path: name(source), source: error })?;
        let written = self.write_into_urdf(&text, &name(source), options)?;
        crate::atomic_file::write(path, |file| file.write_all(written.as_bytes()))
            .map_err(|error| RobotError::Unwritable { path: name(path), source: error })
    }

    /// The robot as MJCF, for MuJoCo: its tree, limits and inertias, and per joint what else takes
    /// torque.
    ///
    /// A link without mass is written without inertia, which MuJoCo accepts where something heavier
    /// follows.
    ///
    /// - `joints`: `[n]`
    ///
    /// # Errors
    /// If a link has a first moment or an inertia that no body has.
    ///
    /// # Panics
    /// If `joints` has not one entry per joint.
    pub fn to_mjcf(&self, joints: &[JointDynamics]) -> Result<String, RobotError> {
        assert_eq!(joints.len(), self.dof(), "one entry per joint");
        let g = self.gravity().to_array();
        let mut text = format!(
            "<mujoco model=\"{}\">\n  <compiler angle=\"radian\" autolimits=\"true\" balanceinertia=\"false\"/>\n  \
             <option gravity=\"{}\"/>\n  <worldbody>\n",
            escaped(self.name()),
            numbers(&g)
        );
        for (index, joint) in self.joints().iter().enumerate() {
            if joint.parent.is_none() {
                self.write_mjcf_body(index, 2, joints, &mut text)?;
            }
        }
        text += "  </worldbody>\n</mujoco>\n";
        Ok(text)
    }

    fn write_mjcf_body(
        &self,
        index: usize,
        depth: usize,
        dynamics: &[JointDynamics],
        text: &mut String,
    ) -> Result<(), RobotError> {
        let (joint, body) = (&self.joints()[index], &self.links()[index]);
        let pad = "  ".repeat(depth);
        let rows = joint.placement.rotation.to_rows();
        let axes = [0, 1].map(|column| rows.map(|row| row[column]));
        let _ = writeln!(
            text,
            "{pad}<body name=\"link_{}\" pos=\"{}\" xyaxes=\"{} {}\">",
            escaped(&joint.name),
            numbers(&joint.placement.translation.to_array()),
            numbers(&axes[0]),
            numbers(&axes[1])
        );
        if *body != LinkInertia::ZERO {
            let (centre, inertia) = body_at_centre(&joint.name, body)?;
            let i = inertia.to_rows();
            let full = [i[0][0], i[1][1], i[2][2], i[0][1], i[0][2], i[1][2]];
            let _ = writeln!(
                text,
                "{pad}  <inertial mass=\"{}\" pos=\"{}\" fullinertia=\"{}\"/>",
                body.mass,
                numbers(&centre),
                numbers(&full)
            );
        }
        let kind = if joint.kind == JointKind::Prismatic { "slide" } else { "hinge" };
        let own = dynamics[index];
        let _ = write!(
            text,
            "{pad}  <joint name=\"{}\" type=\"{kind}\" axis=\"{}\"",
            escaped(&joint.name),
            numbers(&joint.axis.to_array())
        );
        if let Some(range) = joint.limits.position {
            let _ = write!(text, " range=\"{}\"", numbers(&range));
        }
        for (name, value) in [
            ("armature", own.rotor_inertia),
            ("damping", own.viscous_friction),
            ("frictionloss", own.coulomb_friction),
        ] {
            if value != 0.0 {
                let _ = write!(text, " {name}=\"{value}\"");
            }
        }
        text.push_str("/>\n");
        for (child, other) in self.joints().iter().enumerate() {
            if other.parent == Some(index) {
                self.write_mjcf_body(child, depth + 1, dynamics, text)?;
            }
        }
        let _ = writeln!(text, "{pad}</body>");
        Ok(())
    }
}

fn escaped(name: &str) -> String {
    quick_xml::escape::escape(name).into_owned()
}

fn numbers(values: &[f64]) -> String {
    values.iter().map(f64::to_string).collect::<Vec<_>>().join(" ")
}

/// Centre of mass and the inertia about it, if the parameters are those of a body.
fn body_at_centre(link: &str, body: &LinkInertia) -> Result<([f64; 3], Matrix3<f64>), RobotError> {
    let scale =
        body.mass + body.inertia.get(0, 0) + body.inertia.get(1, 1) + body.inertia.get(2, 2);
    let eigenvalue = body.smallest_pseudo_inertia_eigenvalue();
    if body.mass.is_nan() || body.mass <= 0.0 || eigenvalue < -1e-9 * scale {
        return Err(RobotError::NotABody { link: link.into(), mass: body.mass, eigenvalue });
    }
    Ok((body.centre_of_mass().to_array(), body.inertia_at_centre()))
}

fn inertial_element(link: &str, body: &LinkInertia) -> Result<String, RobotError> {
    if *body == LinkInertia::ZERO {
        return Ok(String::new());
    }
    let (centre, inertia) = body_at_centre(link, body)?;
    let i = inertia.to_rows();
    Ok(format!(
        "<inertial><origin xyz=\"{}\" rpy=\"0 0 0\"/><mass value=\"{}\"/><inertia ixx=\"{}\" \
         ixy=\"{}\" ixz=\"{}\" iyy=\"{}\" iyz=\"{}\" izz=\"{}\"/></inertial>",
        numbers(&centre),
        body.mass,
        i[0][0],
        i[0][1],
        i[0][2],
        i[1][1],
        i[1][2],
        i[2][2]
    ))
}

/// What an element replaces in the text.
struct TextSpan {
    replace: Range<usize>,
    shape: TagShape,
    /// The element around it.
    outer: &'static str,
}

enum TagShape {
    /// The element itself.
    Element,
    /// The tag `<link name="...">` of a link, or joint, without one.
    OpenTag,
    /// `<link name="..."/>`.
    EmptyTag,
}

/// Where `<inner>` stands, or would stand, in each named `<outer>` of a robot: the inertia of
/// links, the friction of joints.
fn spans(
    text: &str,
    outer: &'static str,
    inner: &str,
) -> Result<HashMap<String, TextSpan>, String> {
    let mut reader = Reader::from_str(text);
    let mut spans = HashMap::new();
    // Names of the elements around.
    let mut open: Vec<Vec<u8>> = Vec::new();
    let mut named = None;
    let mut inner_from = 0;
    let span = |replace: Range<usize>, shape| TextSpan { replace, shape, outer };
    loop {
        let from = reader.buffer_position() as usize;
        let event = reader.read_event().map_err(|error| error.to_string())?;
        let to = reader.buffer_position() as usize;
        // URDF looks at links and joints that stand right below the robot only.
        let in_robot = open.len() == 1;
        let in_outer = |open: &[Vec<u8>]| open.len() == 2 && open[1] == outer.as_bytes();
        match event {
            Event::Start(tag) => {
                let name = tag.name().as_ref().to_vec();
                if in_robot && name == outer.as_bytes() {
                    let own = name_of(&tag)?;
                    spans.insert(own.clone(), span(from..to, TagShape::OpenTag));
                    named = Some(own);
                } else if in_outer(&open) && name == inner.as_bytes() {
                    inner_from = from;
                }
                open.push(name);
            }
            Event::Empty(tag) if in_robot && tag.name().as_ref() == outer.as_bytes() => {
                spans.insert(name_of(&tag)?, span(from..to, TagShape::EmptyTag));
            }
            Event::Empty(tag) if in_outer(&open) && tag.name().as_ref() == inner.as_bytes() => {
                spans.insert(
                    named.clone().expect("inside a named element"),
                    span(from..to, TagShape::Element),
                );
            }
            Event::End(_) => {
                let name = open.pop();
                if in_outer(&open) && name.as_deref() == Some(inner.as_bytes()) {
                    let named = named.clone().expect("inside a named element");
                    spans.insert(named, span(inner_from..to, TagShape::Element));
                }
            }
            Event::Eof => return Ok(spans),
            _ => {}
        }
    }
}

fn name_of(tag: &BytesStart<'_>) -> Result<String, String> {
    let attribute = tag.try_get_attribute("name").map_err(|error| error.to_string())?;
    let attribute = attribute.ok_or("a link or joint without a name")?;
    attribute.unescape_value().map(|name| name.into_owned()).map_err(|error| error.to_string())
}
