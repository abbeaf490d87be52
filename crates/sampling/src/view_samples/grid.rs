//! The light's grid of buckets: its projections, fitted as those of a shadow map, and the casters of each.

use antumbra_gpu::{Frame, Gpu, GpuError, LightView, bind, light_view_layout};
use antumbra_map::{BodyBoxes, Fitting, SeenView, ShadowMap, Sight, fit_seen};
use glam::{DMat3, DMat4, DVec3, DVec4, Mat4};

/// Most faces that a light has.
pub(super) const FACES: usize = 6;
/// Triangles of a block of casters; `sampling/view_samples_casters.wesl` knows it too.
pub(crate) const BLOCK: u32 = 32;

/// The projections of a light onto buckets. Positions are relative to the frame's origin, metres.
#[derive(Clone, Debug, PartialEq)]
pub struct Grid {
    /// The light as shaders have it: position and 1, or direction towards it and 0.
    pub light: DVec4,
    /// Buckets a side of a face.
    pub side: u32,
    /// One for directional and spot lights, six for the others, in the order of a cube's; `None` where no caster
    /// can shadow what is seen.
    pub faces: Vec<Option<Face>>,
}

/// One projection onto buckets: with d the point relative to the light (to the origin under parallel light), its
/// bucket coordinates are (across . d, along . d) / (distance . d), each with its w for a constant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Face {
    /// Numerator of s.
    pub across: DVec4,
    /// Numerator of t.
    pub along: DVec4,
    /// Distance along the face's axis, 1 under parallel light.
    pub distance: DVec4,
    /// The ray through bucket coordinates (0, 0), at distance 1; under parallel light a point on it.
    pub origin: DVec3,
    /// How it changes with s and t.
    pub steps: [DVec3; 2],
}

impl Face {
    /// The face whose clip matrix is `clip`, under `light`, over `side` x `side` buckets. `None` where the matrix is no
    /// projection.
    pub(super) fn of(clip: DMat4, light: DVec4, side: u32) -> Option<Self> {
        let half = 0.5 * f64::from(side);
        let w = clip.row(3);
        let (mut across, mut along, mut distance) =
            ((clip.row(0) + w) * half, (clip.row(1) + w) * half, w);
        let towards = light.truncate();
        let third = if light.w == 0.0 {
            // Rounding has turned the light a little. What it casts onto one point is to have one place.
            for row in [&mut across, &mut along] {
                let turned = row.truncate()
                    - towards * (row.truncate().dot(towards) / towards.length_squared());
                *row = turned.extend(row.w);
            }
            towards
        } else {
            // Relative to the light there are no constants.
            (across.w, along.w, distance.w) = (0.0, 0.0, 0.0);
            distance.truncate()
        };
        let rows = DMat3::from_cols(across.truncate(), along.truncate(), third).transpose();
        let inverse = rows.inverse();
        let origin = if light.w == 0.0 {
            -(inverse.x_axis * across.w + inverse.y_axis * along.w)
        } else {
            inverse.z_axis
        };
        let steps = [inverse.x_axis, inverse.y_axis];
        inverse.is_finite().then_some(Self { across, along, distance, origin, steps })
    }

    /// Bucket coordinates of a point relative to the light (to the origin under parallel light), if it lies before it.
    #[must_use]
    pub fn place(&self, d: DVec3) -> Option<[f64; 2]> {
        let d = d.extend(1.0);
        let distance = self.distance.dot(d);
        (distance > 0.0).then(|| [self.across.dot(d) / distance, self.along.dot(d) / distance])
    }
}

/// The twin of `Face` in `sampling/view_samples.wesl`.
#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct FaceUniform {
    across: [f32; 4],
    along: [f32; 4],
    distance: [f32; 4],
    origin: [f32; 4],
    step_s: [f32; 4],
    step_t: [f32; 4],
    reach: [f32; 4],
}

/// The twin of `Grid` in `sampling/view_samples.wesl`.
#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
pub(super) struct GridUniform {
    light: [f32; 4],
    size: [u32; 4],
    casters: [u32; 4],
    faces: [FaceUniform; FACES],
}

impl FaceUniform {
    fn new(face: &Face, side: u32) -> Self {
        let [step_s, step_t] = face.steps;
        // Two buckets more than there are, for what lies beside the grid, and a millionth for rounding.
        let reach = face.origin.abs() + (step_s.abs() + step_t.abs()) * (f64::from(side) + 2.0);
        let with = |v: DVec3, w: f64| v.extend(w).as_vec4().to_array();
        Self {
            across: face.across.as_vec4().to_array(),
            along: face.along.as_vec4().to_array(),
            distance: face.distance.as_vec4().to_array(),
            origin: with(face.origin, 0.0),
            step_s: with(step_s, 0.0),
            step_t: with(step_t, 0.0),
            reach: with(reach * (1.0 + 1e-6), 1.0),
        }
    }
}

impl GridUniform {
    /// `entries` places for casters, dispatched `across` in a row; room for `pieces`.
    pub(super) fn new(
        grid: &Grid,
        view: (u32, u32),
        (entries, across): (u32, u32),
        pieces: u32,
    ) -> Self {
        let mut faces = [bytemuck::Zeroable::zeroed(); FACES];
        for (uniform, face) in faces.iter_mut().zip(&grid.faces) {
            if let Some(face) = face {
                *uniform = FaceUniform::new(face, grid.side);
            }
        }
        Self {
            light: grid.light.as_vec4().to_array(),
            size: [grid.side, grid.faces.len() as u32, view.0, view.1],
            casters: [entries, across, pieces, 0],
            faces,
        }
    }
}

/// Fits grids, and keeps what it collects on the way.
#[derive(Debug)]
pub(crate) struct Fitter {
    hull: Vec<DVec3>,
    boxes: BodyBoxes,
    /// Blocks of casters: first triangle, and number of triangles + 64 times the face.
    pub(crate) blocks: Vec<[u32; 2]>,
    /// Of a matrix that nothing draws with: casters are asked which of them a view needs.
    nothing: wgpu::BindGroup,
}

impl Fitter {
    pub(crate) fn new(gpu: &Gpu) -> Self {
        let matrix = bytemuck::bytes_of(&Mat4::IDENTITY).to_vec();
        let buffer = gpu.buffer("light view", &matrix, wgpu::BufferUsages::UNIFORM);
        let nothing = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("light view"),
            layout: &light_view_layout(&gpu.device),
            entries: &[bind::buffer(0, &buffer)],
        });
        Self { hull: Vec::new(), boxes: BodyBoxes::default(), blocks: Vec::new(), nothing }
    }

    /// The grid of the frame's light, `side` buckets a side of each face, over what casters can shadow of what is seen;
    /// and the blocks of these casters.
    pub(super) fn fit(&mut self, frame: &Frame<'_>, side: u32) -> Result<Grid, GpuError> {
        // A bucket around the window, so that what lies beyond it is certainly beyond.
        let fitting =
            Fitting { origin: frame.origin, size: side, guard: 1, receivers: false, grid: 1 };
        let views = self.views(frame, &fitting)?;
        // As the shaders have it, so that both speak of the same rays.
        let light = views[0].view.light.as_vec4().as_dvec4();
        let face = |clip: Option<DMat4>| Face::of(clip?, light, side);
        let faces = views.iter().map(|view| face(view.view.clip)).collect();
        Ok(Grid { light, side, faces })
    }

    /// The views of the frame's light, fitted to what casters can shadow of what is seen; and the blocks of these
    /// casters.
    pub(crate) fn views(
        &mut self,
        frame: &Frame<'_>,
        fitting: &Fitting,
    ) -> Result<Vec<SeenView>, GpuError> {
        self.hull.clear();
        let hull = &mut self.hull;
        frame.casters.hull(frame.light, &mut |p| hull.push(p));
        let region = self.boxes.visible_region(frame);
        let sight = region.as_ref().map(|region| Sight { region, casters: self.boxes.casters() });
        let views = fit_seen(frame.light, &self.hull, sight.as_ref(), fitting)?;
        self.blocks.clear();
        let blocks = &mut self.blocks;
        for (index, view) in views.iter().enumerate() {
            let Some(clip) = view.view.clip else { continue };
            let light_view = LightView {
                clip: clip.as_mat4(),
                bind_group: &self.nothing,
                offset: 0,
                format: ShadowMap::FORMAT,
                order: -1.0,
                light: frame.light,
                origin: frame.origin,
                volume: &view.volume,
                receivers: false,
            };
            frame.casters.ranges(&light_view, &mut |range| {
                blocks.extend(
                    range
                        .clone()
                        .step_by(BLOCK as usize)
                        .map(|first| [first, (range.end - first).min(BLOCK) + 64 * index as u32]),
                );
            });
        }
        Ok(views)
    }
}
