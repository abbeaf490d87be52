//! Where a shadow map puts its texels: warps, cascades, pages that match the view's resolution, and maps whose samples
//! are the view's own.
//!
//! What is a layout here ([`antumbra_map::Arrange`]) serves every estimator and every store.

mod cascade_fit;
mod cascades;
mod eye;
pub mod matched;
mod over;
mod sdsm;
mod splits;
mod storage;
pub mod twin;
pub mod view_samples;
mod warp;
mod warp_fit;
mod warps;

pub use cascades::{CascadeFit, Cascades, Select};
pub use eye::Eye;
pub use matched::{MatchedPages, ResolutionMatched};
pub use sdsm::Sdsm;
pub use splits::Splits;
pub use storage::Body;
pub use view_samples::{ViewSampleMap, ViewSampleMapping};
pub use warp::{Line, Rule, unwarp, warp};
pub use warps::{Lispsm, Psm, Tsm};

pub(crate) use over::over_map;
