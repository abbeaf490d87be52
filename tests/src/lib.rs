//! What the workspace's tests share.

use antumbra_gpu::{Gpu, GpuOptions};

/// The device that tests run on.
///
/// # Panics
/// When there is no adapter; `cargo xtask test` installs a software one where it may.
#[must_use]
pub fn gpu() -> Gpu {
    match Gpu::new(&GpuOptions::default()) {
        Ok(gpu) => gpu,
        Err(error) => panic!("{error}"),
    }
}
