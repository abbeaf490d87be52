//! Silhouettes: the faces of shadow volumes without those that cancel, listed on the GPU each frame.
//!
//! Over an edge where two triangles show the light the same side, one volume ends where the other begins. What
//! bounds all volumes together is their silhouette, about the square root of all edges of a smooth mesh. A few
//! passes find it, none of which the CPU helps with: which bodies need to cast and how; which side each triangle
//! shows the light, once for all of its edges; what is left over each edge; prefix sums for where each goes in the
//! list; the list, and the sizes of the draws that follow.

mod expectation;
mod technique;
pub mod twin;

use antumbra_gpu::{
    BindGroupCache, CasterEdges, CasterTriangles, Gpu, GpuError, Recorder, Scan, ViewSamples, bind,
    entries, read_buffer,
};
use glam::Vec4;
use serde::{Deserialize, Serialize};

use crate::receivers::{Receivers, storage};
use crate::{Method, Savings, VolumeFaces};

pub use technique::{Counted, Silhouette, SilhouetteTechnique};

/// What is known of the casters' meshes, and made use of.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Meshes {
    /// Nothing: any soup of triangles (Aldridge and Woods 2004; Kim, Kim and Turk 2008).
    #[default]
    Soup,
    /// No edge has more than two triangles, and none two that run along it in the same direction (Bergeron
    /// 1986). Other casters are refused. The faces are those of a soup; what is gained is that an edge counts
    /// at most twice.
    Manifold,
    /// All are closed bodies (Crow 1977): only their triangles that face the light cast, and a silhouette counts
    /// once, which halves caps and counts. Other casters are refused. A body that turns its inside out where it
    /// passes through itself may leak there.
    Watertight,
    /// Closed bodies as if watertight, all else as a soup.
    Mixed,
}

/// What the passes are told; `Params` of `volume/silhouettes.wesl`.
#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct Params {
    light: [f32; 4],
    eye: [f32; 4],
    how: [u32; 4],
    list: [u32; 4],
    view: [u32; 4],
}

/// What the faces of a frame are made for.
#[derive(Clone, Copy, Debug)]
pub struct FaceRequest<'a> {
    /// The light, homogeneous, relative to the frame's origin.
    pub light: Vec4,
    /// The eye, homogeneous: its position relative to the frame's origin, metres, and 1, or the unit direction to where
    /// parallel lines of sight come from and 0.
    pub eye: Vec4,
    /// Which faces of a volume are counted.
    pub method: Method,
    /// Whether a side that several volumes have stands in the list as often, for counters that step by one.
    pub by_ones: bool,
    /// What the camera sees. Bodies that shadow none of it are left away; `None` keeps all.
    pub receivers: Option<&'a ViewSamples>,
    /// What of volumes is not drawn.
    pub savings: Savings,
}

/// The passes from triangles and edges to lists of faces.
#[derive(Debug)]
pub struct Silhouettes {
    meshes: Meshes,
    receivers: Receivers,
    passes: [Pass; 4],
    common: wgpu::BindGroupLayout,
    params: wgpu::Buffer,
    side_scan: Scan,
    cap_scan: Scan,
    work: Option<Work>,
    common_group: BindGroupCache<wgpu::Buffer>,
}

/// A pass and the bind group of what it alone reads and writes.
#[derive(Debug)]
struct Pass {
    pipeline: wgpu::ComputePipeline,
    layout: wgpu::BindGroupLayout,
    group: BindGroupCache<Vec<wgpu::Buffer>>,
}

/// Buffers between the passes, for a number of triangles, edges and bodies.
#[derive(Debug)]
struct Work {
    sizes: [u32; 3],
    casters: wgpu::Buffer,
    weights: wgpu::Buffer,
    side_places: wgpu::Buffer,
    cap_places: wgpu::Buffer,
    showing: wgpu::Buffer,
}

impl Work {
    fn new(gpu: &Gpu, sizes: [u32; 3]) -> Result<Self, GpuError> {
        let [triangles, edges, bodies] = sizes.map(u64::from);
        let make = |label, words: u64| storage(gpu, label, 4 * words);
        Ok(Self {
            sizes,
            casters: make("casters", 2 * triangles)?,
            weights: make("edge weights", 4 * edges)?,
            side_places: make("places of sides", edges + 1)?,
            cap_places: make("places of caps", triangles + 1)?,
            showing: make("bodies' sides", bodies)?,
        })
    }

    fn bytes(&self) -> u64 {
        let Self { casters, weights, side_places, cap_places, showing, .. } = self;
        [casters, weights, side_places, cap_places, showing].iter().map(|b| b.size()).sum()
    }
}

/// Threads of a workgroup of the passes, but of that over bodies.
const THREADS: u32 = 256;
const BODY_THREADS: u32 = 64;

// Places of the passes in `Silhouettes::passes`.
const JUDGE: usize = 0;
const FACE: usize = 1;
const WEIGH: usize = 2;
const LIST: usize = 3;

impl Silhouettes {
    /// Builds the passes.
    ///
    /// # Errors
    /// A shader that does not link (a fault of this library).
    pub fn new(gpu: &Gpu, meshes: Meshes) -> Result<Self, GpuError> {
        const CS: wgpu::ShaderStages = wgpu::ShaderStages::COMPUTE;
        let wgsl = antumbra_shaders::link("volume::silhouettes", &[])?;
        let module = gpu.shader("silhouettes", wgsl);
        let layout = |label, entries: &[wgpu::BindGroupLayoutEntry]| {
            let descriptor = wgpu::BindGroupLayoutDescriptor { label: Some(label), entries };
            gpu.device.create_bind_group_layout(&descriptor)
        };
        let read = |n| entries::storage(n, CS);
        let write = |n| entries::write_storage(n, CS);
        let common = layout(
            "silhouettes",
            &[entries::uniform(0, CS), write(1), write(2), write(3), write(4)],
        );
        let pass = |entry, entries: &[wgpu::BindGroupLayoutEntry]| {
            let layout = layout(entry, entries);
            let pipeline = gpu.compute_pipeline(entry, &module, entry, &[&common, &layout]);
            Pass { pipeline, layout, group: BindGroupCache::default() }
        };
        let passes = [
            pass("judge", &[read(0), write(1), read(2), read(3)]),
            pass("face", &[read(0), read(1), read(2), read(3)]),
            pass("weigh", &[read(0), read(1)]),
            pass("list", &[read(0), write(1), write(2), write(3)]),
        ];
        let params = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("silhouettes"),
            size: size_of::<Params>() as u64,
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        Ok(Self {
            meshes,
            receivers: Receivers::new(gpu)?,
            passes,
            common,
            params,
            side_scan: Scan::new(gpu)?,
            cap_scan: Scan::new(gpu)?,
            work: None,
            common_group: BindGroupCache::default(),
        })
    }

    /// Uploads what the passes need to know, and makes `faces` anew where they have no room. Allocates nothing
    /// where sizes and buffers are those of the last call.
    ///
    /// # Errors
    /// Casters that are not as was said of them, or more than the device takes.
    pub fn prepare(
        &mut self,
        gpu: &Gpu,
        triangles: &CasterTriangles<'_>,
        edges: &CasterEdges,
        request: &FaceRequest<'_>,
        faces: &mut Option<VolumeFaces>,
    ) -> Result<(), GpuError> {
        self.check(edges)?;
        let sizes = [triangles.triangles, edges.count, edges.body_count];
        let groups = gpu.device.limits().max_compute_workgroups_per_dimension;
        let (asked, limit) = (sizes[0].max(sizes[1]), groups.saturating_mul(BODY_THREADS));
        if asked > limit {
            let (asked, limit) = (asked.into(), limit.into());
            return Err(GpuError::Limit { what: "triangles or edges of casters", asked, limit });
        }
        let work = match self.work.take() {
            Some(work) if work.sizes == sizes => work,
            _ => Work::new(gpu, sizes)?,
        };
        // A side that counts has used up one of a triangle's three.
        let faces = match faces.take().filter(|f| f.holds(triangles)) {
            Some(kept) => faces.insert(kept),
            None => faces.insert(VolumeFaces::new(gpu, sizes[0].saturating_mul(3), sizes[0])?),
        };
        let reach = request.savings.reach_of_interest();
        self.receivers.prepare(gpu, request.receivers, request.light, reach)?;
        self.side_scan.prepare(gpu, &work.side_places, sizes[1] + 1)?;
        self.cap_scan.prepare(gpu, &work.cap_places, sizes[0] + 1)?;
        let params = self.params(sizes, request);
        gpu.queue.write_buffer(&self.params, 0, bytemuck::bytes_of(&params));
        self.bind(gpu, &work, triangles, edges, faces);
        self.work = Some(work);
        Ok(())
    }

    fn bind(
        &mut self,
        gpu: &Gpu,
        work: &Work,
        triangles: &CasterTriangles<'_>,
        edges: &CasterEdges,
        faces: &VolumeFaces,
    ) {
        let Work { casters, weights, side_places, cap_places, showing, .. } = work;
        self.common_group.get(casters.clone(), |_| {
            let buffers = [&self.params, casters, weights, side_places, cap_places];
            group(gpu, &self.common, &buffers)
        });
        let [fine, coarse] = self.receivers.boxes();
        let own: [&[&wgpu::Buffer]; 4] = [
            &[&edges.bodies, showing, fine, coarse],
            &[triangles.positions, triangles.indices, &edges.body, showing],
            &[&edges.first, &edges.uses],
            &[&edges.vertices, &faces.sides, &faces.caps, &faces.draws],
        ];
        for (pass, buffers) in self.passes.iter_mut().zip(own) {
            let key = buffers.iter().map(|&b| b.clone()).collect();
            let layout = &pass.layout;
            pass.group.get(key, |_| group(gpu, layout, buffers));
        }
    }

    fn params(&self, [triangles, edges, bodies]: [u32; 3], request: &FaceRequest<'_>) -> Params {
        let halve = matches!(self.meshes, Meshes::Watertight | Meshes::Mixed);
        let (width, height) = request.receivers.map_or((0, 0), ViewSamples::size);
        let cull = request.receivers.is_some();
        Params {
            light: request.light.to_array(),
            eye: request.eye.to_array(),
            how: [triangles, edges, bodies, request.method.number()],
            list: [VolumeFaces::VERTICES, request.by_ones.into(), halve.into(), cull.into()],
            view: [width, height, request.savings.instances(), 0],
        }
    }

    /// Records the passes that fill the faces given to [`Silhouettes::prepare`].
    ///
    /// # Errors
    /// A frame that was not prepared.
    pub fn encode(&self, recorder: &mut Recorder<'_>) -> Result<(), GpuError> {
        let unprepared = || GpuError::Invalid {
            what: "frame",
            value: "not prepared".to_owned(),
            fix: "call `prepare` with this frame before `encode`",
        };
        let work = self.work.as_ref().ok_or_else(unprepared)?;
        let common = self.common_group.kept().ok_or_else(unprepared)?;
        let [triangles, edges, _] = work.sizes.map(|count| count.div_ceil(THREADS));
        let mut pass = recorder.compute_pass("volume/silhouettes");
        let run = |pass: &mut wgpu::ComputePass<'_>, step: usize, groups| {
            let Pass { pipeline, group, .. } = &self.passes[step];
            pass.set_pipeline(pipeline);
            pass.set_bind_group(0, common, &[]);
            pass.set_bind_group(1, group.kept().ok_or_else(unprepared)?, &[]);
            pass.dispatch_workgroups(groups, 1, 1);
            Ok::<(), GpuError>(())
        };
        self.receivers.encode(&mut pass);
        run(&mut pass, JUDGE, work.sizes[2].div_ceil(BODY_THREADS))?;
        run(&mut pass, FACE, triangles)?;
        run(&mut pass, WEIGH, edges)?;
        self.side_scan.encode(&mut pass);
        self.cap_scan.encode(&mut pass);
        // Without triangles the draws are still to be written.
        run(&mut pass, LIST, triangles.max(edges).max(1))
    }

    /// Sides and caps in the lists of the last submitted frame, and bodies that cast. Waits.
    ///
    /// # Errors
    /// A lost device.
    pub fn read_sizes(&self, gpu: &Gpu) -> Result<[u64; 3], GpuError> {
        let Some(work) = &self.work else { return Ok([0; 3]) };
        let [triangles, edges, bodies] = work.sizes.map(|count| count as usize);
        let last = |buffer, count: usize| -> Result<u64, GpuError> {
            let places: Vec<u32> = read(gpu, buffer, count + 1)?;
            Ok(places.last().copied().unwrap_or(0).into())
        };
        let showing: Vec<i32> = read(gpu, &work.showing, bodies)?;
        let casting = showing.iter().filter(|s| **s != 0).count() as u64;
        Ok([last(&work.side_places, edges)?, last(&work.cap_places, triangles)?, casting])
    }

    /// Which side each triangle showed the light in the last submitted frame: +1 where its corners run
    /// counter-clockwise, -1 clockwise, 0 where it casts nothing. Waits.
    ///
    /// # Errors
    /// A lost device.
    pub fn read_casters(&self, gpu: &Gpu) -> Result<Vec<i32>, GpuError> {
        let Some(work) = &self.work else { return Ok(Vec::new()) };
        let casters: Vec<[i32; 2]> = read(gpu, &work.casters, work.sizes[0] as usize)?;
        Ok(casters.into_iter().map(|[k, _]| k).collect())
    }

    /// What was left over each edge in the last submitted frame, of volumes that count behind the sample and of
    /// those that count in front. Waits.
    ///
    /// # Errors
    /// A lost device.
    pub fn read_weights(&self, gpu: &Gpu) -> Result<Vec<[i32; 2]>, GpuError> {
        let Some(work) = &self.work else { return Ok(Vec::new()) };
        let weights: Vec<[i32; 4]> = read(gpu, &work.weights, work.sizes[1] as usize)?;
        Ok(weights.into_iter().map(|[behind, in_front, ..]| [behind, in_front]).collect())
    }

    /// Bytes of GPU memory held, without the faces.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        let scans = self.side_scan.bytes() + self.cap_scan.bytes();
        self.work.as_ref().map_or(0, Work::bytes) + scans + self.receivers.bytes()
    }

    fn check(&self, edges: &CasterEdges) -> Result<(), GpuError> {
        let (fault, fix) = match self.meshes {
            Meshes::Soup | Meshes::Mixed => return Ok(()),
            Meshes::Manifold => {
                (edges.not_manifold, "split the mesh there, or choose meshes = \"soup\"")
            }
            Meshes::Watertight => (
                edges.not_watertight,
                "close the mesh there, or choose meshes = \"mixed\" or \"soup\"",
            ),
        };
        fault.map_or(Ok(()), |fault| {
            let ([a, b], along, against) = (fault.vertices, fault.along, fault.against);
            let value = format!(
                "an edge with {along} triangles along it and {against} against it (vertices {a} and {b})"
            );
            Err(GpuError::Invalid { what: "casters", value, fix })
        })
    }
}

fn group(gpu: &Gpu, layout: &wgpu::BindGroupLayout, buffers: &[&wgpu::Buffer]) -> wgpu::BindGroup {
    let entries: Vec<_> =
        buffers.iter().zip(0..).map(|(buffer, binding)| bind::buffer(binding, buffer)).collect();
    gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: Some("silhouettes"),
        layout,
        entries: &entries,
    })
}

/// The first `count` elements of a buffer.
fn read<T: bytemuck::Pod>(
    gpu: &Gpu,
    buffer: &wgpu::Buffer,
    count: usize,
) -> Result<Vec<T>, GpuError> {
    if count == 0 {
        return Ok(Vec::new());
    }
    let bytes = read_buffer(gpu, buffer, (count * size_of::<T>()) as u64)?;
    Ok(bytes.chunks_exact(size_of::<T>()).map(bytemuck::pod_read_unaligned).collect())
}
