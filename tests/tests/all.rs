//! All tests across crates as one program: one link instead of forty, and no core waits for the last test of another.
//!
//! Run a part by its path: `cargo test --release --workspace --test all soft::`.

/// What several of them use.
mod shared {
    pub(crate) mod area;
    pub(crate) mod on_plane;
    pub(crate) mod reticent;
    pub(crate) mod slabs;
    pub(crate) mod traced;
}

mod acne;
mod cascades;
mod composition;
mod cutouts;
mod depth_samples;
mod device;
mod engine;
mod filter_footprints;
mod filter_mipmaps;
mod filter_stores;
mod filter_twins;
mod filter_windows;
mod filtering;
mod filters;
mod fitting;
mod matched;
mod occlusion_textures;
mod omni;
mod peel;
mod per_object;
mod probe;
mod projection;
mod receiver_mask;
mod sampling_error;
mod scaling;
mod scan;
mod scan_lines;
mod sdsm;
mod self_shadowing;
mod silhouette;
mod single_sample;
mod soft;
mod soft_bounds;
mod soft_cases;
mod soft_contacts;
mod soft_emission;
mod soft_exact;
mod soft_twins;
mod stability;
mod storage_factors;
mod tables;
mod traced_texels;
mod translucent;
mod triangles;
mod twins;
mod view_samples;
mod vssm;
mod warps;
mod workspace;
