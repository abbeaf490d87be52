//! Receiver masks: only casters that reach a part of the map which a view sample looks up are drawn.
//!
//! What the camera sees is known sample by sample before shadows are. So each sample marks the texels that its kernel
//! will fetch, in cells of a coarse mask, and each cluster of triangles whose rectangle in the map meets no marked cell
//! is left out. All of it stays on the GPU: the clusters' indices are listed for one indirect draw a view. Texels that
//! nobody reads may hold anything, so visibility does not change by a bit. After the receiver masks of Bittner,
//! Mattausch, Silvennoinen, Wimmer, "Shadow Caster Culling for Efficient Shadow Mapping" (2011), who draw receivers
//! where this marks samples.
//!
//! Where views are fitted on the GPU, so that the CPU does not know their windows, casters are listed by these alone:
//! what lies outside would be clipped.

use antumbra_gpu::{
    BindGroupCache, CasterClusters, Frame, Gpu, GpuError, Recorder, ViewSamples, bind, entries,
    read_buffer,
};
use glam::Mat4;

use crate::{Layout, ShadowMap};

/// Cells a side of the mask, at most: 8 KiB a layer.
const CELLS: u32 = 256;

/// Bytes of an indexed indirect draw.
const DRAW: u64 = 20;

/// Bytes of the draws of one view: of whole triangles and of triangles with holes.
pub(crate) const DRAWS: u64 = 2 * DRAW;

/// `Mask` of `map/mask.wesl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
struct MaskUniform {
    size: u32,
    cell: u32,
    words: u32,
    rows: u32,
    reach: f32,
    pad: [u32; 3],
}

/// `Culled` of `map/cull_clusters.wesl`.
#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct CulledUniform {
    clusters: u32,
    kept: u32,
    layer: u32,
    holes: u32,
}

/// The mask of a light's map, or its views' windows alone, and what is listed by it.
#[derive(Debug)]
pub(crate) struct ReceiverMask {
    layout: Layout,
    /// Nothing where windows alone decide.
    mark: Option<wgpu::ComputePipeline>,
    cull: wgpu::ComputePipeline,
    mark_layout: wgpu::BindGroupLayout,
    views_layout: wgpu::BindGroupLayout,
    cull_layout: wgpu::BindGroupLayout,
    clusters_layout: wgpu::BindGroupLayout,
    stride: u32,
    mask: MaskUniform,
    mask_buffer: wgpu::Buffer,
    room: Option<Room>,
    mark_group: BindGroupCache<([wgpu::TextureView; 2], wgpu::Buffer)>,
    views_group: BindGroupCache<wgpu::Buffer>,
    cull_group: BindGroupCache<[wgpu::Buffer; 2]>,
    clusters_group: BindGroupCache<[wgpu::Buffer; 2]>,
    /// Clusters that the CPU kept, a bit each, view by view.
    kept: Vec<u32>,
    clusters: u32,
    views: u32,
}

/// Buffers for a number of views, clusters and indices.
#[derive(Debug)]
struct Room {
    views: u32,
    clusters: u32,
    indices: u32,
    cells: wgpu::Buffer,
    kept: wgpu::Buffer,
    culled: wgpu::Buffer,
    /// Draws without any index, to begin with.
    blank: wgpu::Buffer,
    draws: wgpu::Buffer,
    listed: wgpu::Buffer,
}

impl ReceiverMask {
    /// Links and compiles the passes for the views of `layout`, in a map of `size` texels a side whose texels are read
    /// up to `radius` texels from a sample's own place; without a radius, for lists of what lies in the views' windows.
    ///
    /// # Errors
    /// A layout whose shader does not link.
    pub(crate) fn new(
        gpu: &Gpu,
        layout: &Layout,
        size: u32,
        radius: Option<f32>,
    ) -> Result<Self, GpuError> {
        const CS: wgpu::ShaderStages = wgpu::ShaderStages::COMPUTE;
        let group = |label, entries: &[wgpu::BindGroupLayoutEntry]| {
            let descriptor = wgpu::BindGroupLayoutDescriptor { label: Some(label), entries };
            gpu.device.create_bind_group_layout(&descriptor)
        };
        let mark_layout = group(
            "receiver mask",
            &[
                entries::texels(0, CS, false),
                entries::texels(1, CS, false),
                entries::uniform(2, CS),
                entries::write_storage(3, CS),
            ],
        );
        let views_layout = group("receiver mask: views", &[entries::storage(0, CS)]);
        let cull_layout = group(
            "culled clusters",
            &[
                entries::dynamic_uniform(0, CS),
                entries::uniform(1, CS),
                entries::storage(2, CS),
                entries::storage(3, CS),
                entries::write_storage(4, CS),
                entries::write_storage(5, CS),
                entries::dynamic_uniform(6, CS),
            ],
        );
        let clusters_layout =
            group("clusters", &[entries::storage(0, CS), entries::storage(1, CS)]);
        let mark = match radius {
            Some(_) => Some(antumbra_shaders::link("map::receiver_mask", &layout.slots)?),
            None => None,
        };
        let mark = mark.map(|mark| {
            let mark = gpu.shader("receiver mask", mark);
            gpu.compute_pipeline("receiver mask", &mark, "mark", &[&mark_layout, &views_layout])
        });
        let cull = antumbra_shaders::link("map::cull_clusters", &[])?;
        let cull = gpu.shader("culled clusters", cull);
        let cell = size.div_ceil(CELLS);
        let rows = if mark.is_some() { size.div_ceil(cell) } else { 0 };
        let mask = MaskUniform {
            size,
            cell,
            words: rows.div_ceil(32),
            rows,
            // Half a texel from its place to its texel's middle is within the radius; one more is for rounding.
            reach: radius.unwrap_or_default() + 1.0,
            pad: [0; 3],
        };
        Ok(Self {
            layout: layout.clone(),
            mark,
            cull: gpu.compute_pipeline(
                "culled clusters",
                &cull,
                "cull",
                &[&cull_layout, &clusters_layout],
            ),
            mark_layout,
            views_layout,
            cull_layout,
            clusters_layout,
            stride: gpu
                .device
                .limits()
                .min_uniform_buffer_offset_alignment
                .max(size_of::<CulledUniform>() as u32),
            mask,
            mask_buffer: gpu.buffer(
                "receiver mask",
                bytemuck::bytes_of(&mask),
                wgpu::BufferUsages::UNIFORM,
            ),
            room: None,
            mark_group: BindGroupCache::default(),
            views_group: BindGroupCache::default(),
            cull_group: BindGroupCache::default(),
            clusters_group: BindGroupCache::default(),
            kept: Vec::new(),
            clusters: 0,
            views: 0,
        })
    }

    /// Whether the passes are those of `layout`, with marks or without.
    pub(crate) fn serves(&self, layout: &Layout, marked: bool) -> bool {
        self.layout == *layout && self.mark.is_some() == marked
    }

    /// Takes note of the clusters that may matter in each view of `map`, and uploads them.
    ///
    /// # Errors
    /// More clusters than the device takes.
    pub(crate) fn prepare(
        &mut self,
        gpu: &Gpu,
        frame: &Frame<'_>,
        map: &ShadowMap,
        clusters: &CasterClusters<'_>,
    ) -> Result<(), GpuError> {
        let words = clusters.count.div_ceil(32).max(1);
        self.kept.clear();
        self.clusters = clusters.count;
        let mut uniforms = Vec::new();
        for (layer, view) in map.light_views(frame).enumerate() {
            let first = self.kept.len();
            self.kept.resize(first + words as usize, 0);
            let kept = &mut self.kept[first..];
            frame.casters.kept_clusters(&view, &mut |range| {
                range.for_each(|i| kept[i as usize / 32] |= 1 << (i % 32));
            });
            let culled = CulledUniform {
                clusters: clusters.count,
                kept: first as u32,
                layer: layer as u32,
                holes: clusters.holes,
            };
            uniforms.resize(layer * self.stride as usize, 0);
            uniforms.extend_from_slice(bytemuck::bytes_of(&culled));
        }
        self.views = map.light_views(frame).count() as u32;
        if self.views == 0 {
            return Ok(());
        }
        let fits = |room: &Room| {
            room.views >= self.views
                && room.clusters >= clusters.count
                && room.indices >= clusters.indices_count
        };
        if !self.room.as_ref().is_some_and(fits) {
            self.room = Some(Room::new(gpu, self.views, clusters, &self.mask, self.stride)?);
        }
        if let Some(room) = &self.room {
            gpu.queue.write_buffer(&room.kept, 0, bytemuck::cast_slice(&self.kept));
            gpu.queue.write_buffer(&room.culled, 0, &uniforms);
            let blank: Vec<u32> =
                (0..self.views).flat_map(|_| [0, 1, 0, 0, 0, 0, 1, clusters.holes, 0, 0]).collect();
            gpu.queue.write_buffer(&room.blank, 0, bytemuck::cast_slice(&blank));
        }
        Ok(())
    }

    /// Records the marks of `samples`, looked up in `views` (of `map::views`), and empties the lists.
    pub(crate) fn encode_marks(
        &mut self,
        gpu: &Gpu,
        recorder: &mut Recorder<'_>,
        samples: &ViewSamples,
        views: &wgpu::Buffer,
    ) {
        let Some(room) = self.room.as_ref().filter(|_| self.views > 0) else { return };
        let bytes = u64::from(self.views) * DRAWS;
        recorder.encoder.copy_buffer_to_buffer(&room.blank, 0, &room.draws, 0, bytes);
        let Some(pipeline) = &self.mark else { return };
        recorder.encoder.clear_buffer(&room.cells, 0, None);
        let textures = [samples.positions_view.clone(), samples.normals_view.clone()];
        let mark = self.mark_group.get((textures, room.cells.clone()), |(textures, cells)| {
            gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("receiver mask"),
                layout: &self.mark_layout,
                entries: &[
                    bind::texture(0, &textures[0]),
                    bind::texture(1, &textures[1]),
                    bind::buffer(2, &self.mask_buffer),
                    bind::buffer(3, cells),
                ],
            })
        });
        let views = self.views_group.get(views.clone(), |views| {
            gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("receiver mask: views"),
                layout: &self.views_layout,
                entries: &[bind::buffer(0, views)],
            })
        });
        let (width, height) = samples.size();
        let mut pass = recorder.compute_pass("map/receiver_mask");
        pass.set_pipeline(pipeline);
        pass.set_bind_group(0, mark, &[]);
        pass.set_bind_group(1, views, &[]);
        pass.dispatch_workgroups(width.div_ceil(8), height.div_ceil(8), 1);
    }

    /// Records the list of triangles for the view in `layer`, drawn by its matrix in `matrices` (with the bytes from one to
    /// the next), for one use before the next list. Gives the indices, and the draws with their offset.
    pub(crate) fn encode_list(
        &mut self,
        gpu: &Gpu,
        recorder: &mut Recorder<'_>,
        layer: u32,
        (matrices, stride): (&wgpu::Buffer, u32),
        clusters: &CasterClusters<'_>,
    ) -> Option<(&wgpu::Buffer, &wgpu::Buffer, u64)> {
        let room = self.room.as_ref()?;
        let key = [room.listed.clone(), matrices.clone()];
        let cull = self.cull_group.get(key, |[listed, matrices]| {
            let culled = first(&room.culled, size_of::<CulledUniform>());
            let clip = first(matrices, size_of::<Mat4>());
            gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("culled clusters"),
                layout: &self.cull_layout,
                entries: &[
                    wgpu::BindGroupEntry {
                        binding: 0,
                        resource: wgpu::BindingResource::Buffer(culled),
                    },
                    bind::buffer(1, &self.mask_buffer),
                    bind::buffer(2, &room.cells),
                    bind::buffer(3, &room.kept),
                    bind::buffer(4, &room.draws),
                    bind::buffer(5, listed),
                    wgpu::BindGroupEntry {
                        binding: 6,
                        resource: wgpu::BindingResource::Buffer(clip),
                    },
                ],
            })
        });
        let key = [clusters.clusters.clone(), clusters.indices.clone()];
        let bound = self.clusters_group.get(key, |[clusters, indices]| {
            gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("clusters"),
                layout: &self.clusters_layout,
                entries: &[bind::buffer(0, clusters), bind::buffer(1, indices)],
            })
        });
        let mut pass = recorder.compute_pass("map/cull");
        pass.set_pipeline(&self.cull);
        pass.set_bind_group(0, cull, &[layer * self.stride, layer * stride]);
        pass.set_bind_group(1, bound, &[]);
        let groups = self.clusters.div_ceil(64);
        // As many rows as a dispatch's width leaves over: the limit is 65535.
        let rows = groups.div_ceil(WIDEST).max(1);
        pass.dispatch_workgroups(groups.min(WIDEST), rows, 1);
        drop(pass);
        Some((&room.listed, &room.draws, u64::from(layer) * DRAWS))
    }

    /// Triangles that the last submitted frame drew. Waits.
    ///
    /// # Errors
    /// A lost device.
    pub(crate) fn read_triangles(&self, gpu: &Gpu) -> Result<u64, GpuError> {
        let Some(room) = self.room.as_ref().filter(|_| self.views > 0) else {
            return Ok(0);
        };
        let bytes = read_buffer(gpu, &room.draws, u64::from(self.views) * DRAWS)?;
        let words: &[u32] = bytemuck::cast_slice(&bytes);
        Ok(words.chunks_exact(5).map(|draw| u64::from(draw[0] / 3)).sum())
    }

    /// Bytes of GPU memory held.
    pub(crate) fn bytes(&self) -> u64 {
        let room = self.room.as_ref().map_or(0, |room| {
            let all =
                [&room.cells, &room.kept, &room.culled, &room.blank, &room.draws, &room.listed];
            all.into_iter().map(wgpu::Buffer::size).sum()
        });
        room + self.mask_buffer.size()
    }
}

/// The first `size` bytes of a buffer that is bound at offsets.
fn first(buffer: &wgpu::Buffer, size: usize) -> wgpu::BufferBinding<'_> {
    wgpu::BufferBinding { buffer, offset: 0, size: wgpu::BufferSize::new(size as u64) }
}

/// Workgroups in a row of a dispatch.
const WIDEST: u32 = 32768;

impl Room {
    fn new(
        gpu: &Gpu,
        views: u32,
        clusters: &CasterClusters<'_>,
        mask: &MaskUniform,
        stride: u32,
    ) -> Result<Self, GpuError> {
        let listed = u64::from(clusters.indices_count.max(1)) * 4;
        let limits = gpu.device.limits();
        let limit = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size);
        if listed > limit {
            return Err(GpuError::Limit {
                what: "bytes of listed triangles",
                asked: listed,
                limit,
            });
        }
        let buffer = |label, size, usage| {
            gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size,
                usage: usage | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            })
        };
        use wgpu::BufferUsages as Usages;
        let many = u64::from(views);
        let words = u64::from(mask.words) * u64::from(mask.rows);
        let kept = u64::from(clusters.count.div_ceil(32).max(1));
        Ok(Self {
            views,
            clusters: clusters.count,
            indices: clusters.indices_count,
            // Without marks, a word that nobody reads.
            cells: buffer("receiver mask", (many * words * 4).max(4), Usages::STORAGE),
            kept: buffer("clusters that may matter", many * kept * 4, Usages::STORAGE),
            culled: buffer("culled views", many * u64::from(stride), Usages::UNIFORM),
            blank: buffer("draws of nothing", many * DRAWS, Usages::COPY_SRC),
            draws: buffer(
                "draws",
                many * DRAWS,
                Usages::STORAGE | Usages::INDIRECT | Usages::COPY_SRC,
            ),
            listed: buffer("listed triangles", listed, Usages::STORAGE | Usages::INDEX),
        })
    }
}
