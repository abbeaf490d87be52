//! The meshes with holes of a set, and what it takes to draw them. A set without any has none of this.

use std::collections::HashMap;
use std::sync::Arc;

use antumbra_scene::{AlphaMap, CutInstance, Cutout, Triangles};

use super::pipelines::{depth_pipeline, samples_pipeline};
use crate::{Gpu, GpuError, bind, entries};

/// Passes and data for triangles with holes.
#[derive(Debug)]
pub(super) struct Cutouts {
    /// As [`Coordinates`], for all vertices of the set.
    pub(super) coordinates: wgpu::Buffer,
    /// Group 1 of both passes.
    pub(super) group: wgpu::BindGroup,
    pub(super) depth: wgpu::RenderPipeline,
    pub(super) samples: wgpu::RenderPipeline,
}

/// A vertex, as `coordinates` in `gpu/view_samples_cut.wesl`.
#[repr(C)]
#[derive(Clone, Copy, Default, bytemuck::Pod, bytemuck::Zeroable)]
struct Coordinates {
    uv: [f32; 2],
    cutout: u32,
}

/// `Cutout` of `gpu/cutout.wesl`.
#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct Record {
    size: [u32; 2],
    first: u32,
    modes: u32,
    cutoff: f32,
    pad: u32,
}

impl Record {
    fn new(cutout: &Cutout, first: u32) -> Self {
        let AlphaMap { width, height, wrap, nearest, .. } = *cutout.alpha;
        let modes = wrap[0] as u32 | (wrap[1] as u32) << 2 | u32::from(nearest) << 4;
        Self { size: [width, height], first, modes, cutoff: cutout.cutoff, pad: 0 }
    }
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
        triangles.cuts.iter().try_for_each(|cut| check(triangles, cut))?;
        let limits = gpu.device.limits();
        let limit = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size);
        let within = |what, asked: u64| {
            (asked <= limit).then_some(()).ok_or(GpuError::Limit { what, asked, limit })
        };
        within("bytes of texture coordinates", triangles.positions.len() as u64 * 12)?;
        let mut coordinates = vec![Coordinates::default(); triangles.positions.len()];
        let (mut records, mut texels, mut known) = (Vec::new(), Vec::new(), HashMap::new());
        for (number, cut) in triangles.cuts.iter().enumerate() {
            let alpha = &cut.cutout.alpha;
            let first = match known.get(&Arc::as_ptr(alpha)) {
                Some(first) => *first,
                None => {
                    let first = texels.len();
                    within("texels of alpha", first as u64 + alpha.texels.len() as u64)?;
                    texels.extend_from_slice(&alpha.texels);
                    known.insert(Arc::as_ptr(alpha), first as u32);
                    first as u32
                }
            };
            records.push(Record::new(&cut.cutout, first));
            let vertices = coordinates.iter_mut().skip(cut.first_vertex as usize);
            for (vertex, uv) in vertices.zip(&cut.cutout.uv) {
                *vertex = Coordinates { uv: uv.to_array(), cutout: number as u32 };
            }
        }
        texels.resize(texels.len().next_multiple_of(4), 0);
        let storage = wgpu::BufferUsages::STORAGE;
        let records = gpu.buffer("cut-outs", bytemuck::cast_slice(&records), storage);
        let texels = gpu.buffer("alpha", &texels, storage);
        let coordinates = gpu.buffer(
            "texture coordinates",
            bytemuck::cast_slice(&coordinates),
            storage | wgpu::BufferUsages::VERTEX,
        );
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

/// Checks that a cut-out has a texture, and texture coordinates for all corners of its triangles.
fn check(triangles: &Triangles, cut: &CutInstance) -> Result<(), GpuError> {
    let first = cut.first_vertex;
    let end = u64::from(first) + cut.cutout.uv.len() as u64;
    let has_uv = |i: &u32| *i >= first && u64::from(*i) < end;
    let range = triangles.instances.get(cut.instance).cloned();
    let list = range.and_then(|range| triangles.triangles.get(range));
    let complete = list.is_some_and(|list| list.iter().flatten().all(has_uv));
    if complete && cut.cutout.alpha.is_valid() {
        return Ok(());
    }
    Err(GpuError::Invalid {
        what: "cut-out",
        value: format!("that of instance {}", cut.instance),
        fix: "give it a texture, and texture coordinates of all its vertices; `Scene::triangles` checks both",
    })
}
