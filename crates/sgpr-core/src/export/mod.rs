//! A model as a source file that stands on its own, in C or Rust: for controllers that take no
//! library.
//!
//! The same code that a [`Predictor`](crate::model::Predictor) runs is run once over
//! [expressions](crate::expression), so that what is exported is what was validated: the recursion
//! of the robot's links and the law of each effect are written nowhere else. Zeros and ones of the
//! robot are taken out, constants are folded, and what is needed twice is computed once.

mod c;
mod printer;
mod program;
mod rust;
mod text;

use std::fmt;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use derive_setters::Setters;

use self::program::FormulaProgram;
use crate::atomic_file;
use crate::effects::Effect;
use crate::gp::Precision;
use crate::model::{Purpose, StreamError, StreamOptions, TorqueModel};

/// The language of an exported model.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Language {
    /// C99, which C++ compilers take as well; needs `math.h` alone.
    C,
    /// Rust, without a crate.
    Rust,
}

impl Language {
    /// All of them.
    pub const ALL: [Self; 2] = [Self::C, Self::Rust];

    /// Its name: `c`, `rust`.
    pub fn name(self) -> &'static str {
        match self {
            Self::C => "c",
            Self::Rust => "rust",
        }
    }
}

/// The width of numbers by its name: `double`, `single`.
///
/// # Errors
/// If it is none.
pub fn precision(name: &str) -> Result<Precision, ExportError> {
    match name {
        "double" => Ok(Precision::Double),
        "single" => Ok(Precision::Single),
        _ => Err(ExportError::Precision { name: name.into() }),
    }
}

impl FromStr for Language {
    type Err = ExportError;

    fn from_str(name: &str) -> Result<Self, Self::Err> {
        let found = Self::ALL.into_iter().find(|language| language.name() == name);
        found.ok_or_else(|| ExportError::Language { name: name.into() })
    }
}

/// How a model is exported.
#[derive(Clone, Debug, PartialEq, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
pub struct ExportOptions {
    /// Language of the file.
    pub language: Language,
    /// Width of its numbers; times have 64 bits in both.
    pub precision: Precision,
    /// What names in the file begin with, after `sgpr_`; by default the name of the robot.
    pub name: Option<String>,
    /// Rate of the calls, purpose, and effects to keep, as for a predictor.
    pub stream: StreamOptions,
}

impl ExportOptions {
    /// Code for a controller: the torque that the arm needs.
    pub fn new(language: Language) -> Self {
        let stream = StreamOptions::default().with_purpose(Purpose::FeedForward);
        Self { language, precision: Precision::Double, name: None, stream }
    }
}

/// Why a model is not exported.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ExportError {
    /// A language that is none.
    #[error("language: got `{name}`, expected `c` or `rust`")]
    Language {
        /// What was asked for.
        name: String,
    },
    /// A width of numbers that is none.
    #[error("precision: got `{name}`, expected `double` or `single`")]
    Precision {
        /// What was asked for.
        name: String,
    },
    /// A name that identifiers cannot begin with.
    #[error(
        "name: got {name:?}, expected at most 40 letters, digits and underscores, as `left_arm`"
    )]
    Name {
        /// The name.
        name: String,
    },
    /// A model that cannot be streamed.
    #[error(transparent)]
    Stream(#[from] StreamError),
    /// An effect whose law is not known as a formula.
    #[error(
        "{effect} cannot be exported: {reason}; take it out, or run the model with \
         TorqueModel::predictor (Model.predictor in Python)"
    )]
    Effect {
        /// Name of the effect.
        effect: String,
        /// Why.
        reason: String,
    },
    /// A file that cannot be written.
    #[error("{}: {reason}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// What the system says.
        reason: String,
    },
}

impl fmt::Display for Language {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl TorqueModel {
    /// The model as a source file that needs nothing but the standard mathematics of its language.
    /// The torque is that of [`TorqueModel::predictor`] with the same options, called once per
    /// period.
    ///
    /// # Errors
    /// As [`TorqueModel::predictor`]; if the law of an effect is not known as a formula, as that of
    /// an effect from Python.
    ///
    /// # Examples
    /// ```
    /// use sgpr_core::export::{ExportOptions, Language};
    /// use sgpr_core::{model::TorqueModel, robot::two_link};
    /// let code = TorqueModel::nominal(&two_link()).export(&ExportOptions::new(Language::C)).unwrap();
    /// assert!(code.contains("int sgpr_two_link_torque("));
    /// ```
    pub fn export(&self, options: &ExportOptions) -> Result<String, ExportError> {
        let name = text::identifier(options.name.as_deref(), self.robot().name())?;
        // Everything that a predictor refuses is refused here.
        self.predictor(&options.stream)?;
        for effect in self
            .parameter_set()
            .effects()
            .iter()
            .chain(self.terms().iter().map(|term| &term.effect))
        {
            if options.stream.holds(effect.as_ref()) {
                check(effect.as_ref())?;
            }
        }
        let program = FormulaProgram::record(self, &options.stream);
        Ok(match options.language {
            Language::C => c::file(&name, &program, options.precision),
            Language::Rust => rust::file(&name, &program, options.precision),
        })
    }

    /// Writes [`Self::export`] to a file, which is complete or not there.
    ///
    /// # Errors
    /// As [`Self::export`]; if the file cannot be written.
    pub fn export_to(
        &self,
        path: impl AsRef<Path>,
        options: &ExportOptions,
    ) -> Result<(), ExportError> {
        let (path, code) = (path.as_ref(), self.export(options)?);
        let failed = |error: std::io::Error| ExportError::Write {
            path: path.into(),
            reason: error.to_string(),
        };
        atomic_file::write(path, |file| file.write_all(code.as_bytes())).map_err(failed)
    }
}

fn check(effect: &dyn Effect) -> Result<(), ExportError> {
    if effect.is_generic() {
        return Ok(());
    }
    let reason = "it is an effect of a user, given as a function and not as a formula".into();
    Err(ExportError::Effect { effect: effect.name().into(), reason })
}
