//! The radius of a filter's kernel, for the scaling suite.

use antumbra::Config;
use antumbra_filter::Savsm;

use super::plan::{Entry, Plan};
use super::scaling::Sweep;

/// Radii of the kernel, texels.
const RADII: [u32; 5] = [1, 2, 4, 8, 16];

/// Techniques that the suite measures for this plot, beside those of the quick suite: a table, in which a window costs the
/// same whatever its size, and an N-buffer.
pub(super) const TECHNIQUES: [&str; 3] =
    ["filter/savsm", "filter/multiple-depth", "filter/multiple-depth-n-buffer"];

/// Whether the technique is for this plot alone: an N-buffer of a large map takes gigabytes.
pub(super) fn is_only_here(entry: &Entry) -> bool {
    matches!(&entry.config, Config::MultipleDepth(settings) if settings.n_buffer)
}

/// Error and time of every technique of the plan that has a kernel of texels.
pub(super) fn sweep(plan: &Plan) -> Sweep {
    let mut entries: Vec<Entry> = Vec::new();
    for entry in &plan.techniques {
        let set_to = |radius| {
            let mut config = entry.config.clone();
            set(&mut config, radius);
            config
        };
        let [small, large] = [1, 2].map(set_to);
        // Variants that differ in nothing but the radius are one.
        let same = |e: &Entry| {
            let mut other = e.config.clone();
            set(&mut other, 1);
            other == small
        };
        if small != large && !entries.iter().any(same) {
            entries.push(entry.clone());
        }
    }
    Sweep { parameter: "kernel_radius", values: &RADII, set, entries }
}

/// Kernels of 2 `radius` + 1 texels a side.
fn set(config: &mut Config, radius: u32) {
    let side = 2 * radius + 1;
    match config {
        Config::PcfGrid(settings) => settings.side = side,
        Config::PcfBilinearGrid(settings) => settings.side = side,
        Config::MultipleDepth(settings) => settings.radius = radius,
        Config::Savsm(settings) => {
            let radius = radius as f32;
            *settings = Savsm { radius, follow_pixels: false, ..*settings };
        }
        Config::Vsm(settings) => settings.filter.radius = radius,
        Config::Lvsm(settings) => settings.filter.radius = radius,
        Config::Esm(settings) => settings.filter.radius = radius,
        Config::Evsm(settings) => settings.filter.radius = radius,
        Config::Msm(settings) => settings.filter.radius = radius,
        Config::PowerFunction(settings) => settings.filter.radius = radius,
        Config::Convolution(settings) => settings.filter.radius = radius,
        _ => {}
    }
}
