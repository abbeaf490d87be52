//! The pass that finds where a volume has to be drawn: of each triangle, or of each body.

use antumbra_gpu::{
    BindGroupCache, CasterEdges, CasterTriangles, Gpu, GpuError, Recorder, ViewSamples, bind,
    entries, read_buffer,
};
use glam::Vec4;

use crate::litmap::{Litmap, LitmapRequest};
use crate::receivers::{Receivers, storage};
use crate::triangles::dispatch;
use crate::{Savings, VolumeFaces};

/// The pass; `volume/clamp.wesl`.
#[derive(Debug)]
pub(crate) struct Clamp {
    savings: Savings,
    receivers: Receivers,
    litmap: Option<Litmap>,
    triangles: wgpu::ComputePipeline,
    bodies: wgpu::ComputePipeline,
    layouts: [wgpu::BindGroupLayout; 3],
    uniform: wgpu::Buffer,
    left: wgpu::Buffer,
    limits: wgpu::Buffer,
    group: BindGroupCache<Vec<wgpu::Buffer>>,
    boxes: BindGroupCache<[wgpu::Buffer; 2]>,
    dispatch: [u32; 2],
}

/// The twin of `Make` in the shader.
#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct Make {
    light: [f32; 4],
    eye: [f32; 4],
    how: [u32; 4],
    cut: [u32; 4],
    contact: f32,
    unused: [f32; 3],
}

/// What is clamped for.
#[derive(Clone, Copy)]
pub(crate) struct ClampRequest<'a> {
    pub(crate) samples: &'a ViewSamples,
    /// Triangles or bodies.
    pub(crate) volumes: u32,
    pub(crate) light: Vec4,
    /// The eye, homogeneous.
    pub(crate) eye: Vec4,
    pub(crate) contact: f32,
    /// Edges of the casters, where there may be hidden ones or where volumes are of bodies.
    pub(crate) edges: Option<&'a CasterEdges>,
}

/// Bytes of a `Limit`.
const LIMIT: u64 = 16;

impl Clamp {
    /// Builds the pass.
    ///
    /// # Errors
    /// A shader that does not link (a fault of this library).
    pub(crate) fn new(gpu: &Gpu, savings: Savings) -> Result<Self, GpuError> {
        const CS: wgpu::ShaderStages = wgpu::ShaderStages::COMPUTE;
        let layout = |entries: &[wgpu::BindGroupLayoutEntry]| {
            gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
                label: Some("volume/clamp"),
                entries,
            })
        };
        let (read, write) = (|n| entries::storage(n, CS), |n| entries::write_storage(n, CS));
        let uniform = entries::uniform(0, CS);
        let layouts = [
            layout(&[uniform, read(1), read(2), write(3), write(4), write(5), write(6)]),
            layout(&[uniform, write(5), write(6), read(7)]),
            layout(&[read(2), read(3)]),
        ];
        let module = gpu.shader("volume/clamp", antumbra_shaders::link("volume::clamp", &[])?);
        let [of_triangles, of_bodies, of_boxes] = &layouts;
        let pipeline =
            |entry, own| gpu.compute_pipeline("volume/clamp", &module, entry, &[own, of_boxes]);
        Ok(Self {
            savings,
            receivers: Receivers::new(gpu)?,
            litmap: if savings.litmap > 0 { Some(Litmap::new(gpu, savings)?) } else { None },
            triangles: pipeline("clamp_triangles", of_triangles),
            bodies: pipeline("clamp_bodies", of_bodies),
            layouts,
            uniform: gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("volume/clamp"),
                size: size_of::<Make>() as u64,
                usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            }),
            left: storage(gpu, "volumes left", 8)?,
            limits: storage(gpu, "limits of volumes", 0)?,
            group: BindGroupCache::default(),
            boxes: BindGroupCache::default(),
            dispatch: [0; 2],
        })
    }

    /// Uploads what the pass needs to know.
    ///
    /// # Errors
    /// A failed allocation.
    pub(crate) fn prepare(
        &mut self,
        gpu: &Gpu,
        request: &ClampRequest<'_>,
    ) -> Result<(), GpuError> {
        let ClampRequest { samples, volumes, light, eye, contact, edges } = *request;
        self.receivers.prepare(gpu, Some(samples), light, self.savings.reach_of_interest())?;
        if let Some(litmap) = &mut self.litmap {
            let edges = edges.map_or(0, |edges| edges.count);
            litmap.prepare(gpu, &LitmapRequest { samples, volumes, light, contact, edges })?;
        }
        let room = LIMIT * u64::from(volumes);
        if self.limits.size() < room {
            self.limits = storage(gpu, "limits of volumes", room)?;
        }
        let row;
        (self.dispatch, row) = dispatch(gpu, volumes);
        let (width, height) = samples.size();
        let Savings { near, far, window, .. } = self.savings;
        let make = Make {
            light: light.to_array(),
            eye: eye.to_array(),
            how: [volumes, width, row, height],
            cut: [near.into(), far.into(), window.into(), self.litmap.is_some().into()],
            contact,
            unused: [0.0; 3],
        };
        gpu.queue.write_buffer(&self.uniform, 0, bytemuck::bytes_of(&make));
        Ok(())
    }

    /// Records the pass over `faces`, of one volume for each triangle.
    pub(crate) fn encode_triangles(
        &mut self,
        gpu: &Gpu,
        recorder: &mut Recorder<'_>,
        triangles: &CasterTriangles<'_>,
        edges: Option<&CasterEdges>,
        faces: &VolumeFaces,
    ) {
        if let Some(litmap) = &mut self.litmap {
            litmap.encode(gpu, recorder, triangles, edges, false, &self.limits);
        }
        let own =
            [(1, triangles.positions), (2, triangles.indices), (3, &faces.sides), (4, &faces.caps)];
        self.encode(gpu, recorder, 0, &own);
    }

    /// Records the pass over bodies.
    pub(crate) fn encode_bodies(
        &mut self,
        gpu: &Gpu,
        recorder: &mut Recorder<'_>,
        triangles: &CasterTriangles<'_>,
        edges: &CasterEdges,
    ) {
        if let Some(litmap) = &mut self.litmap {
            litmap.encode(gpu, recorder, triangles, Some(edges), true, &self.limits);
        }
        self.encode(gpu, recorder, 1, &[(7, &edges.bodies)]);
    }

    fn encode(
        &mut self,
        gpu: &Gpu,
        recorder: &mut Recorder<'_>,
        of: usize,
        own: &[(u32, &wgpu::Buffer)],
    ) {
        recorder.encoder.clear_buffer(&self.left, 0, None);
        let make = |layout, entries: &[wgpu::BindGroupEntry<'_>]| {
            gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("volume/clamp"),
                layout,
                entries,
            })
        };
        let mut key: Vec<_> = own.iter().map(|(_, buffer)| (*buffer).clone()).collect();
        key.push(self.limits.clone());
        let group = self.group.get(key, |_| {
            let mut all = vec![
                bind::buffer(0, &self.uniform),
                bind::buffer(5, &self.left),
                bind::buffer(6, &self.limits),
            ];
            all.extend(own.iter().map(|(binding, buffer)| bind::buffer(*binding, buffer)));
            make(&self.layouts[of], &all)
        });
        let boxes = self.boxes.get(self.receivers.boxes().map(Clone::clone), |[fine, coarse]| {
            make(&self.layouts[2], &[bind::buffer(2, fine), bind::buffer(3, coarse)])
        });
        let mut pass = recorder.compute_pass("volume/clamp");
        self.receivers.encode(&mut pass);
        pass.set_pipeline([&self.triangles, &self.bodies][of]);
        pass.set_bind_group(0, group, &[]);
        pass.set_bind_group(1, boxes, &[]);
        pass.dispatch_workgroups(self.dispatch[0], self.dispatch[1], 1);
    }

    /// What was found: a `Limit` for each volume.
    pub(crate) fn limits(&self) -> &wgpu::Buffer {
        &self.limits
    }

    /// How many volumes were left in the last submitted frame, and how many boxes around samples were asked. Waits.
    ///
    /// # Errors
    /// A lost device.
    pub(crate) fn read_counters(&self, gpu: &Gpu) -> Result<[(&'static str, u64); 2], GpuError> {
        let bytes = read_buffer(gpu, &self.left, 8)?;
        let [left, asked] = bytemuck::pod_read_unaligned::<[u32; 2]>(&bytes);
        Ok([("casting_volumes", left.into()), ("asked_boxes", asked.into())])
    }

    /// Bytes of GPU memory held.
    pub(crate) fn bytes(&self) -> u64 {
        let litmap = self.litmap.as_ref().map_or(0, Litmap::bytes);
        self.receivers.bytes() + self.left.size() + self.limits.size() + litmap
    }
}
