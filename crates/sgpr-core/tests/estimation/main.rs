//! Estimators, physical consistency, payloads, confidence and screening, on an arm of which
//! everything is known.
#![allow(missing_docs)]

mod arm;
mod confidence;
mod consistency;
mod estimators;
#[path = "../common/noise.rs"]
mod noise;
mod nonlinear;
mod payload;
mod prior;
mod screening;
