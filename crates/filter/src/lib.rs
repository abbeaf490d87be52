//! Filtered hard shadows over any shadow map of [`antumbra_map`].
//!
//! Percentage-closer filtering (Reeves, Salesin, Cook 1987) compares first and averages then:
//! `V = sum_i k_i H(z_i - z)`. The kernels differ in shape, smoothness and cost; all are configs with
//! an `estimator`, which [`antumbra_map::MapTechnique`] runs over every layout.

pub mod kernel;
mod pcf;

pub use pcf::{PcfBilinearGrid, PcfCastano, PcfGrid, PcfHardware, PcfPoisson};
