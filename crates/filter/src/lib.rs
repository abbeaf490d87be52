//! Filtered hard shadows over any shadow map of [`antumbra_map`].
//!
//! Percentage-closer filtering (Reeves, Salesin, Cook 1987) compares first and averages then:
//! `V = sum_i k_i H(z_i - z)`. The kernels differ in shape, smoothness and cost; all are configs with
//! an `estimator`, which [`antumbra_map::MapTechnique`] runs over every layout.
//!
//! Filterable maps average first: moments or exponentials of depth, filtered once a map ([`Prefilter`]), bound
//! the same sum from above at a cost a sample that does not grow with the kernel.

mod beside;
mod blurred_depth;
mod convolution;
mod esm;
mod expectation;
mod eye;
mod interleaved;
pub mod kernel;
mod lvsm;
mod msm;
mod multiple_depth;
mod nbuffer;
mod pcf;
mod pcf_footprint;
mod power_function;
mod prefilter;
mod savsm;
pub mod twin;
mod vsm;

pub use blurred_depth::{BlurredDepth, SoftComparison};
pub use convolution::Convolution;
pub use esm::{Esm, Evsm, Fallback};
pub use interleaved::Interleaved;
pub use lvsm::Lvsm;
pub use msm::Msm;
pub use multiple_depth::MultipleDepth;
pub use pcf::{
    PcfAdaptive, PcfBilinearGrid, PcfCastano, PcfCubic, PcfGrid, PcfHardware, PcfPoisson,
};
pub use pcf_footprint::PcfFootprint;
pub use power_function::PowerFunction;
pub use prefilter::{Footprint, Prefilter, Shape};
pub use savsm::{Savsm, Table};
pub use vsm::Vsm;
