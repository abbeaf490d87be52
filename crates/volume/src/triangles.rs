//! One volume for each triangle: the simplest producer of faces, right for any soup of triangles.

use antumbra_gpu::{BindGroupCache, CasterTriangles, Gpu, GpuError, Recorder, bind, entries};
use glam::Vec4;

use crate::VolumeFaces;

/// Which faces of a volume are counted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// Those behind the sample (z-fail).
    Behind,
    /// Those in front of it (z-pass).
    InFront,
    /// Those in front of it for volumes that certainly do not contain the eye, else those behind it.
    Choose,
}

impl Method {
    /// As the shaders have it.
    pub(crate) fn number(self) -> u32 {
        match self {
            Self::Behind => 0,
            Self::InFront => 1,
            Self::Choose => 2,
        }
    }
}

/// A compute pass with one invocation a triangle.
#[derive(Debug)]
pub(crate) struct TrianglePass {
    name: &'static str,
    pipeline: wgpu::ComputePipeline,
    layout: wgpu::BindGroupLayout,
    uniform: wgpu::Buffer,
    group: BindGroupCache<Vec<wgpu::Buffer>>,
    dispatch: [u32; 2],
}

/// The twin of `Make` in the shaders.
#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
pub(crate) struct MakeUniform {
    pub(crate) light: [f32; 4],
    pub(crate) eye: [f32; 4],
    pub(crate) how: [u32; 4],
}

/// Invocations of a workgroup.
const GROUP: u32 = 64;

/// Workgroups of 64 invocations for one a triangle, and invocations a row of them.
pub(crate) fn dispatch(gpu: &Gpu, triangles: u32) -> ([u32; 2], u32) {
    let groups = triangles.div_ceil(GROUP);
    let across = groups.min(gpu.device.limits().max_compute_workgroups_per_dimension);
    ([across, if across == 0 { 0 } else { groups.div_ceil(across) }], across * GROUP)
}

impl TrianglePass {
    /// Links the module at `root`, whose entry point reads the triangles and writes `outputs` buffers.
    pub(crate) fn new(
        gpu: &Gpu,
        name: &'static str,
        root: &str,
        entry_point: &str,
        outputs: u32,
    ) -> Result<Self, GpuError> {
        const CS: wgpu::ShaderStages = wgpu::ShaderStages::COMPUTE;
        let device = &gpu.device;
        let mut bindings =
            vec![entries::uniform(0, CS), entries::storage(1, CS), entries::storage(2, CS)];
        bindings.extend((0..outputs).map(|i| entries::write_storage(3 + i, CS)));
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some(name),
            entries: &bindings,
        });
        let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some(name),
            layout: Some(&device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                label: Some(name),
                bind_group_layouts: &[Some(&layout)],
                immediate_size: 0,
            })),
            module: &gpu.shader(name, antumbra_shaders::link(root, &[])?),
            entry_point: Some(entry_point),
            compilation_options: Default::default(),
            cache: None,
        });
        let uniform = device.create_buffer(&wgpu::BufferDescriptor {
            label: Some(name),
            size: size_of::<MakeUniform>() as u64,
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let group = BindGroupCache::default();
        Ok(Self { name, pipeline, layout, uniform, group, dispatch: [0; 2] })
    }

    pub(crate) fn prepare(&mut self, gpu: &Gpu, triangles: u32, light: Vec4, eye: Vec4, how: u32) {
        let row;
        (self.dispatch, row) = dispatch(gpu, triangles);
        let uniform = MakeUniform {
            light: light.to_array(),
            eye: eye.to_array(),
            how: [triangles, how, row, 0],
        };
        gpu.queue.write_buffer(&self.uniform, 0, bytemuck::bytes_of(&uniform));
    }

    pub(crate) fn encode(
        &mut self,
        gpu: &Gpu,
        recorder: &mut Recorder<'_>,
        triangles: &CasterTriangles<'_>,
        outputs: &[&wgpu::Buffer],
    ) {
        let inputs = [triangles.positions, triangles.indices];
        let key = inputs.iter().chain(outputs).map(|&b| b.clone()).collect();
        let group = self.group.get(key, |buffers: &Vec<wgpu::Buffer>| {
            let mut bound = vec![bind::buffer(0, &self.uniform)];
            bound.extend((1..).zip(buffers).map(|(i, buffer)| bind::buffer(i, buffer)));
            gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some(self.name),
                layout: &self.layout,
                entries: &bound,
            })
        });
        let mut pass = recorder.compute_pass(self.name);
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, group, &[]);
        pass.dispatch_workgroups(self.dispatch[0], self.dispatch[1], 1);
    }
}

/// The compute pass that makes one volume of each triangle.
#[derive(Debug)]
pub struct TriangleFaces(TrianglePass);

impl TriangleFaces {
    /// Builds the pass.
    ///
    /// # Errors
    /// A shader that does not link (a fault of this library).
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let pass =
            TrianglePass::new(gpu, "volume/faces", "volume::triangle_faces", "make_faces", 2)?;
        Ok(Self(pass))
    }

    /// Uploads what the pass needs to know, and makes `faces` anew where they have no room. `light` is homogeneous
    /// ([`crate::homogeneous_light`]), as is `eye`: a position relative to the frame's origin and 1, or the unit
    /// direction to where parallel lines of sight come from and 0.
    ///
    /// # Errors
    /// More triangles than one buffer takes faces.
    pub fn prepare(
        &mut self,
        gpu: &Gpu,
        triangles: &CasterTriangles<'_>,
        light: Vec4,
        eye: Vec4,
        method: Method,
        faces: &mut Option<VolumeFaces>,
    ) -> Result<(), GpuError> {
        let count = triangles.triangles;
        let faces = match faces.take().filter(|f| f.holds(triangles)) {
            Some(kept) => faces.insert(kept),
            None => faces.insert(VolumeFaces::new(gpu, count.saturating_mul(3), count)?),
        };
        faces.set_draws(gpu, 3 * count, count);
        self.0.prepare(gpu, count, light, eye, method.number());
        Ok(())
    }

    /// Records the pass.
    pub fn encode(
        &mut self,
        gpu: &Gpu,
        recorder: &mut Recorder<'_>,
        triangles: &CasterTriangles<'_>,
        faces: &VolumeFaces,
    ) {
        self.0.encode(gpu, recorder, triangles, &[&faces.sides, &faces.caps]);
    }
}
