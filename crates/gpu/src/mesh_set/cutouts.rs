//! The meshes with holes of a set, and what it takes to draw them. A set without any has none of this.

use antumbra_scene::Triangles;

use super::pipelines::{depth_pipeline, samples_pipeline};
use super::textures::{Textured, Textures};
use crate::{Gpu, GpuError, bind, entries};

/// Passes and data for triangles with holes.
#[derive(Debug)]
pub(super) struct Cutouts {
    /// As [`Textures::coordinates`].
    pub(super) coordinates: wgpu::Buffer,
    /// Group 1 of both passes.
    pub(super) group: wgpu::BindGroup,
    pub(super) depth: wgpu::RenderPipeline,
    pub(super) samples: wgpu::RenderPipeline,
}

impl Cutouts {
    /// Uploads the cut-outs of `triangles`; `None` where there are none.
    ///
    /// # Errors
    /// Cut-outs without their data, or more of it than the device takes in one buffer.
    pub(super) fn new(
        gpu: &Gpu,
        triangles: &Triangles,
        samples: &wgpu::BindGroupLayout,
    ) -> Result<Option<Self>, GpuError> {
        if triangles.cuts.is_empty() {
            return Ok(None);
        }
        let surfaces = triangles.cuts.iter().map(|cut| Textured {
            what: "cut-out",
            instance: cut.instance,
            first_vertex: cut.first_vertex,
            uv: &cut.cutout.uv,
            alpha: &cut.cutout.alpha,
            number: cut.cutout.cutoff,
        });
        let Textures { coordinates, records, texels } = Textures::new(gpu, triangles, surfaces)?;
        let layout = gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("cut-outs"),
            entries: &[
                entries::storage(0, wgpu::ShaderStages::FRAGMENT),
                entries::storage(1, wgpu::ShaderStages::FRAGMENT),
                entries::storage(2, wgpu::ShaderStages::VERTEX),
            ],
        });
        let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("cut-outs"),
            layout: &layout,
            entries: &[
                bind::buffer(0, &records),
                bind::buffer(1, &texels),
                bind::buffer(2, &coordinates),
            ],
        });
        Ok(Some(Self {
            coordinates,
            group,
            depth: depth_pipeline(gpu, Some(&layout))?,
            samples: samples_pipeline(gpu, samples, Some(&layout))?,
        }))
    }
}
