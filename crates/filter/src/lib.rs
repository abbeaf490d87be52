//! Filtered hard shadows over any shadow map of [`antumbra_map`].
//!
//! Percentage-closer filtering (Reeves, Salesin, Cook 1987) compares first and averages then:
//! `V = sum_i k_i H(z_i - z)`. The kernels differ in shape, smoothness and cost; all are configs with
//! an `estimator`, which [`antumbra_map::MapTechnique`] runs over every layout.
//!
//! Filterable maps average first: moments or exponentials of depth, filtered once a map ([`Prefilter`]), bound
//! the same sum from above at a cost a sample that does not grow with the kernel.

mod esm;
mod expectation;
pub mod kernel;
mod lvsm;
mod msm;
mod pcf;
mod prefilter;
pub mod twin;
mod vsm;

pub use esm::{Esm, Evsm};
pub use lvsm::Lvsm;
pub use msm::Msm;
pub use pcf::{
    PcfAdaptive, PcfBilinearGrid, PcfCastano, PcfCubic, PcfGrid, PcfHardware, PcfPoisson,
};
pub use prefilter::{Prefilter, Shape};
pub use vsm::Vsm;
