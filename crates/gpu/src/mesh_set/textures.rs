//! Textures of alpha on the GPU, for cut-outs and translucent surfaces.

use std::collections::HashMap;
use std::sync::Arc;

use antumbra_scene::{AlphaMap, Triangles};
use glam::Vec2;

use crate::{Gpu, GpuError};

/// An instance with a texture of alpha.
pub(super) struct Textured<'a> {
    /// What it is, for messages.
    pub(super) what: &'static str,
    pub(super) instance: usize,
    /// Its first vertex, which has the first of `uv`.
    pub(super) first_vertex: u32,
    pub(super) uv: &'a [Vec2],
    pub(super) alpha: &'a Arc<AlphaMap>,
    /// What alpha is compared with or multiplied by.
    pub(super) number: f32,
}

/// Textures of several instances.
#[derive(Debug)]
pub(super) struct Textures {
    /// For each vertex of the set, texture coordinates and the number of its record; all zero without a texture.
    pub(super) coordinates: wgpu::Buffer,
    pub(super) records: wgpu::Buffer,
    /// Alpha in 1/255, four texels a word.
    pub(super) texels: wgpu::Buffer,
}

/// A vertex, as `coordinates` in `gpu/view_samples_cut.wesl`.
#[repr(C)]
#[derive(Clone, Copy, Default, bytemuck::Pod, bytemuck::Zeroable)]
struct Coordinates {
    uv: [f32; 2],
    record: u32,
}

/// `Cutout` of `gpu/cutout.wesl`.
#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct Record {
    size: [u32; 2],
    first: u32,
    modes: u32,
    number: f32,
    pad: u32,
}

impl Record {
    fn new(surface: &Textured<'_>, first: u32) -> Self {
        let AlphaMap { width, height, wrap, nearest, .. } = **surface.alpha;
        let modes = wrap[0] as u32 | (wrap[1] as u32) << 2 | u32::from(nearest) << 4;
        Self { size: [width, height], first, modes, number: surface.number, pad: 0 }
    }
}

impl Textures {
    /// Uploads the textures of `surfaces`, of which there is at least one, and their places on `triangles`.
    ///
    /// # Errors
    /// Surfaces without their data, or more of it than the device takes in one buffer.
    pub(super) fn new<'a>(
        gpu: &Gpu,
        triangles: &Triangles,
        surfaces: impl Iterator<Item = Textured<'a>>,
    ) -> Result<Self, GpuError> {
        let limits = gpu.device.limits();
        let limit = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size);
        let within = |what, asked: u64| {
            (asked <= limit).then_some(()).ok_or(GpuError::Limit { what, asked, limit })
        };
        within("bytes of texture coordinates", triangles.positions.len() as u64 * 12)?;
        let mut coordinates = vec![Coordinates::default(); triangles.positions.len()];
        let (mut records, mut texels, mut known) = (Vec::new(), Vec::new(), HashMap::new());
        for (number, surface) in surfaces.enumerate() {
            check(triangles, &surface)?;
            let alpha = surface.alpha;
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
            records.push(Record::new(&surface, first));
            let vertices = coordinates.iter_mut().skip(surface.first_vertex as usize);
            for (vertex, uv) in vertices.zip(surface.uv) {
                *vertex = Coordinates { uv: uv.to_array(), record: number as u32 };
            }
        }
        texels.resize(texels.len().next_multiple_of(4), 0);
        let storage = wgpu::BufferUsages::STORAGE;
        Ok(Self {
            coordinates: gpu.buffer(
                "texture coordinates",
                bytemuck::cast_slice(&coordinates),
                storage | wgpu::BufferUsages::VERTEX,
            ),
            records: gpu.buffer("textures", bytemuck::cast_slice(&records), storage),
            texels: gpu.buffer("alpha", &texels, storage),
        })
    }
}

/// Checks that a surface has a texture, and texture coordinates for all corners of its triangles.
fn check(triangles: &Triangles, surface: &Textured<'_>) -> Result<(), GpuError> {
    let first = surface.first_vertex;
    let end = u64::from(first) + surface.uv.len() as u64;
    let has_uv = |i: &u32| *i >= first && u64::from(*i) < end;
    let range = triangles.instances.get(surface.instance).cloned();
    let list = range.and_then(|range| triangles.triangles.get(range));
    let complete = list.is_some_and(|list| list.iter().flatten().all(has_uv));
    if complete && surface.alpha.is_valid() {
        return Ok(());
    }
    Err(GpuError::Invalid {
        what: surface.what,
        value: format!("that of instance {}", surface.instance),
        fix: "give it a texture, and texture coordinates of all its vertices; `Scene::triangles` checks both",
    })
}
