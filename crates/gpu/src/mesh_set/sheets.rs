//! The translucent meshes of a set. A set without any has none of this.

use antumbra_scene::Triangles;

use super::textures::{Textured, Textures};
use crate::{CasterTriangles, Gpu, GpuError, TranslucentTriangles};

/// Triangles that let light through; their positions are those of the set.
#[derive(Debug)]
pub(super) struct Sheets {
    indices: wgpu::Buffer,
    objects: wgpu::Buffer,
    textures: Textures,
    count: u32,
}

impl Sheets {
    /// Uploads the translucent meshes of `triangles`; `None` where there are none.
    ///
    /// # Errors
    /// Opacities without their data, or more of it than the device takes in one buffer.
    pub(super) fn new(gpu: &Gpu, triangles: &Triangles) -> Result<Option<Self>, GpuError> {
        let surfaces = triangles.translucent.iter().map(|sheet| Textured {
            what: "opacity",
            instance: sheet.instance,
            first_vertex: sheet.first_vertex,
            uv: &sheet.opacity.uv,
            alpha: &sheet.opacity.alpha,
            number: sheet.opacity.factor,
        });
        if triangles.translucent.is_empty() {
            return Ok(None);
        }
        let textures = Textures::new(gpu, triangles, surfaces)?;
        let (mut indices, mut objects) = (Vec::new(), Vec::new());
        for sheet in &triangles.translucent {
            let list = &triangles.triangles[triangles.instances[sheet.instance].clone()];
            indices.extend_from_slice(list);
            objects.resize(indices.len(), sheet.instance as u32);
        }
        if indices.is_empty() {
            return Ok(None);
        }
        let usages = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::INDEX;
        Ok(Some(Self {
            count: indices.len() as u32,
            indices: gpu.buffer("translucent indices", bytemuck::cast_slice(&indices), usages),
            objects: gpu.buffer("translucent objects", bytemuck::cast_slice(&objects), usages),
            textures,
        }))
    }

    /// The triangles over the set's `positions`, of which there are `vertices`.
    pub(super) fn triangles<'a>(
        &'a self,
        positions: &'a wgpu::Buffer,
        vertices: u32,
    ) -> TranslucentTriangles<'a> {
        let Self { indices, objects, textures, count } = self;
        TranslucentTriangles {
            triangles: CasterTriangles { positions, indices, objects, vertices, triangles: *count },
            coordinates: &textures.coordinates,
            textures: &textures.records,
            texels: &textures.texels,
        }
    }
}
