//! Techniques that keep a surface from shadowing itself by what the map holds or how it is drawn, one config
//! each. Their lookups compare the receiver's own depth, with nothing of the derived [`Bias`] but the bound on
//! rounding, so that each shows what it does by itself.

use antumbra_gpu::{
    Counters, Expectation, Frame, Gpu, GpuError, Recorder, Technique, TechniqueConfig,
};
use serde::{Deserialize, Serialize};

use crate::expectation::self_shadowing as expected;
use crate::{
    Between, Bias, CasterDepth, DepthPeel, Estimator, Faces, MapConfig, MapTechnique,
    PolygonOffset, ShadowMap, Store,
};

/// What a second-depth map holds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SecondSurface {
    /// The nearest faces whose front looks away from the light: the far sides of closed bodies. One pass.
    #[default]
    BackFaces,
    /// The second surface behind each texel, whichever way it faces. Two passes.
    SecondLayer,
}

/// Second-depth shadow map (Wang, Molnar 1994): what hides a receiver is the far side of a caster, which is
/// dark anyway, so lit faces have nothing near to be compared with. For closed bodies; an open sheet that faces
/// the light casts no shadow.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SecondDepth {
    /// Side of the map (of one face, for a cube), texels; 1 to the device's limit (at least 8192), default
    /// 2048. Memory and fill cost grow with its square.
    pub size: u32,
    /// Which surface is the second. Default: back faces, as games do it.
    pub surface: SecondSurface,
    /// Constant bias, metres of light depth, >= 0, default 0. It opens a gap behind a body on a floor lit at
    /// the elevation a, `bias` cos a wide.
    pub bias: f32,
}

/// Midpoint shadow map (Woo 1992): the occluder is halfway between the first two surfaces, where there is
/// nothing.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Midpoint {
    /// Side of the map (of one face, for a cube), texels; 1 to the device's limit (at least 8192), default
    /// 2048. Memory, three times that of a plain map, and fill cost, twice, grow with its square.
    pub size: u32,
}

/// Dual depth layers (Weiskopf, Ertl 2003): the midpoint, but never farther than a limit behind the first
/// surface.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DualLayers {
    /// Side of the map (of one face, for a cube), texels; 1 to the device's limit (at least 8192), default
    /// 2048. Memory, three times that of a plain map, and fill cost, twice, grow with its square.
    pub size: u32,
    /// The limit, in sides of a texel at the first surface, >= 0. Default sqrt(3) / 2: half a texel times the
    /// slope of a plane at 60 degrees to the light. (The source leaves it to the scene.) 0 is a plain map
    /// without bias.
    pub limit: f32,
}

/// The bias of old: the hardware's polygon offset while the map is drawn, and nothing at the lookup.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SlopeBias {
    /// Side of the map (of one face, for a cube), texels; 1 to the device's limit (at least 8192), default
    /// 2048. Memory and fill cost grow with its square.
    pub size: u32,
    /// Factor on a triangle's slope, >= 0, default 2.5. Along the texels' rows 1 suffices for a plane; at a
    /// contact it opens a gap of about `factor` texels.
    pub factor: f32,
    /// Steps of the stored depth, >= 0, default 10. Rounding needs as many.
    pub units: i32,
}

/// Normal offset (Holbert 2011): the receiver is looked up a little off its surface.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct NormalOffset {
    /// Side of the map (of one face, for a cube), texels; 1 to the device's limit (at least 8192), default
    /// 2048. Memory and fill cost grow with its square.
    pub size: u32,
    /// The offset, in sides of a texel times the sine of the angle between the normal and the map's axis (the
    /// light's direction, in parallel light), >= 0. Default 0.72. A plane at any angle, in parallel light and in
    /// perspective, needs the distance of a texel's corner from its centre and the rasteriser's step:
    /// sqrt(2) (1/2 + 1/256) = 0.713.
    pub offset: f32,
}

const SIZE: u32 = 2048;

impl Default for SecondDepth {
    fn default() -> Self {
        Self { size: SIZE, surface: SecondSurface::default(), bias: 0.0 }
    }
}

impl Default for Midpoint {
    fn default() -> Self {
        Self { size: SIZE }
    }
}

impl Default for DualLayers {
    fn default() -> Self {
        Self { size: SIZE, limit: 0.5 * 3f32.sqrt() }
    }
}

impl Default for SlopeBias {
    fn default() -> Self {
        Self { size: SIZE, factor: 2.5, units: 10 }
    }
}

impl Default for NormalOffset {
    fn default() -> Self {
        Self { size: SIZE, offset: 0.72 }
    }
}

/// Of map size and bias, with the nearest texel.
fn map(size: u32, bias: Bias) -> (MapConfig, Estimator) {
    (MapConfig { size, bias, ..MapConfig::default() }, Estimator::nearest())
}

impl TechniqueConfig for SecondDepth {
    fn build(&self, gpu: &Gpu) -> Result<Box<dyn Technique>, GpuError> {
        let (config, nearest) = map(self.size, Bias { metres: self.bias, ..Bias::ROUNDING });
        let technique = match self.surface {
            SecondSurface::BackFaces => MapTechnique::new(gpu, &config, nearest)?
                .drawn_by(CasterDepth::new(gpu, Faces::Back, PolygonOffset::default())?),
            SecondSurface::SecondLayer => {
                let second = Box::new(SecondLayer(DepthPeel::new(gpu, 1)?));
                MapTechnique::with_store(gpu, &config, nearest, second)?.drawn_by(first_layer(gpu)?)
            }
        };
        Ok(Box::new(technique))
    }

    fn set_map_size(&mut self, size: u32) {
        self.size = size;
    }

    fn expectation(&self, case: &str) -> Option<Expectation> {
        expected::second_depth(self, case)
    }
}

impl Midpoint {
    /// The technique, as [`TechniqueConfig::build`] gives it.
    ///
    /// # Errors
    /// A size beyond the device's limits.
    pub fn technique(&self, gpu: &Gpu) -> Result<MapTechnique, GpuError> {
        between(gpu, self.size, f64::INFINITY)
    }
}

impl TechniqueConfig for Midpoint {
    fn build(&self, gpu: &Gpu) -> Result<Box<dyn Technique>, GpuError> {
        Ok(Box::new(self.technique(gpu)?))
    }

    fn set_map_size(&mut self, size: u32) {
        self.size = size;
    }

    fn expectation(&self, case: &str) -> Option<Expectation> {
        expected::midpoint(self, case)
    }
}

impl TechniqueConfig for DualLayers {
    fn build(&self, gpu: &Gpu) -> Result<Box<dyn Technique>, GpuError> {
        let limit = at_least_zero("limit", self.limit)?;
        Ok(Box::new(between(gpu, self.size, limit.into())?))
    }

    fn set_map_size(&mut self, size: u32) {
        self.size = size;
    }

    fn expectation(&self, case: &str) -> Option<Expectation> {
        expected::dual_layers(self, case)
    }
}

impl TechniqueConfig for SlopeBias {
    fn build(&self, gpu: &Gpu) -> Result<Box<dyn Technique>, GpuError> {
        let factor = at_least_zero("factor", self.factor)?;
        if self.units < 0 {
            let fix = "use at least 0; the default is 10";
            return Err(GpuError::Invalid { what: "units", value: self.units.to_string(), fix });
        }
        let (config, nearest) = map(self.size, Bias::NONE);
        let offset = PolygonOffset { factor, units: self.units };
        let drawn = CasterDepth::new(gpu, Faces::Both, offset)?;
        Ok(Box::new(MapTechnique::new(gpu, &config, nearest)?.drawn_by(drawn)))
    }

    fn set_map_size(&mut self, size: u32) {
        self.size = size;
    }

    fn expectation(&self, case: &str) -> Option<Expectation> {
        expected::slope_bias(self, case)
    }
}

impl TechniqueConfig for NormalOffset {
    fn build(&self, gpu: &Gpu) -> Result<Box<dyn Technique>, GpuError> {
        let (config, nearest) = map(self.size, Bias { normal: self.offset, ..Bias::ROUNDING });
        Ok(Box::new(MapTechnique::new(gpu, &config, nearest)?))
    }

    fn set_map_size(&mut self, size: u32) {
        self.size = size;
    }

    fn expectation(&self, case: &str) -> Option<Expectation> {
        expected::normal_offset(self, case)
    }
}

fn at_least_zero(what: &'static str, value: f32) -> Result<f32, GpuError> {
    if value.is_finite() && value >= 0.0 {
        return Ok(value);
    }
    let fix = "use a finite number of at least 0";
    Err(GpuError::Invalid { what, value: value.to_string(), fix })
}

/// The first layer, as [`DepthPeel`] needs it.
fn first_layer(gpu: &Gpu) -> Result<CasterDepth, GpuError> {
    CasterDepth::new(gpu, Faces::Both, PolygonOffset::default())
}

fn between(gpu: &Gpu, size: u32, limit: f64) -> Result<MapTechnique, GpuError> {
    let (config, nearest) = map(size, Bias::ROUNDING);
    let store = Box::new(Between::new(gpu, limit)?);
    Ok(MapTechnique::with_store(gpu, &config, nearest, store)?.drawn_by(first_layer(gpu)?))
}

/// The second layer alone, as a store.
#[derive(Debug)]
struct SecondLayer(DepthPeel);

impl Store for SecondLayer {
    fn prepare(&mut self, gpu: &Gpu, frame: &Frame<'_>, map: &ShadowMap) -> Result<(), GpuError> {
        self.0.prepare(gpu, frame, map)
    }

    fn encode(
        &mut self,
        gpu: &Gpu,
        frame: &Frame<'_>,
        map: &ShadowMap,
        recorder: &mut Recorder<'_>,
    ) -> Result<(), GpuError> {
        self.0.encode(gpu, frame, map, recorder)
    }

    fn view(&self) -> Option<&wgpu::TextureView> {
        self.0.layer(0).map(|(_, view)| view)
    }

    fn counters(&self) -> Counters {
        self.0.counters().clone()
    }

    fn bytes(&self) -> u64 {
        self.0.bytes()
    }
}
