//! A shadow map with an estimator, as a technique.

use antumbra_gpu::{
    Counters, Expectation, Frame, Gpu, GpuError, Recorder, Technique, TechniqueConfig,
};
use antumbra_shaders::Slot;
use serde::{Deserialize, Serialize};

use crate::receiver_mask::ReceiverMask;
use crate::{
    Arrange, Bias, CasterDepth, DepthConvention, Drawing, Estimator, Layout, MapRead, Omni,
    PerObject, Refit, Resolve, ShadowMap, ShadowView, Store, caster_depth, expectation,
};

/// Settings that every technique over a shadow map shares.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MapConfig {
    /// Side of the map (of one face, for a cube), texels; 1 to the device's limit (at least 8192), default
    /// 2048. Memory and fill cost grow with its square, error falls with its inverse.
    pub size: u32,
    /// Depth bias.
    pub bias: Bias,
    /// Layout of the map for lights that shine all around, default the cube.
    pub omni: Omni,
    /// Whether casters are chosen, on the GPU, by what view samples look up of the map, default no. Visibility does not
    /// change by a bit. Costs a pass over the view samples and one over the casters' clusters a view, and room for
    /// the indices of all triangles; saves the casters that shadow only what the camera does not see. For estimators
    /// that compare texels of the map itself, over projections by matrix and casters in clusters
    /// ([`antumbra_gpu::Casters::clusters`]); other casters and projections are drawn as without, and so are layouts that
    /// do not say which views they look up (`map::looked_up`).
    pub receiver_mask: bool,
    /// Number of maps that objects have for themselves under directional and spot lights, up to 64; default 0: one map
    /// around all casters. With more objects than maps, neighbours share one. Each map costs a pass and a layer, and
    /// each view sample a lookup in every map; a map's texels are as fine as its object is small. See
    /// [`crate::PerObject`].
    pub objects: u32,
}

impl Default for MapConfig {
    fn default() -> Self {
        Self {
            size: 2048,
            bias: Bias::default(),
            omni: Omni::default(),
            receiver_mask: false,
            objects: 0,
        }
    }
}

impl MapConfig {
    /// Who fits the views.
    fn arrange(&self) -> Result<Box<dyn Arrange>, GpuError> {
        if self.objects == 0 {
            return Ok(Box::new(self.omni));
        }
        if self.receiver_mask {
            return Err(GpuError::Invalid {
                what: "receiver mask",
                value: "over maps of single objects".to_owned(),
                fix: "choose one of `receiver_mask` and `objects`: a mask knows one view a sample",
            });
        }
        let arrange = PerObject { most: self.objects, omni: self.omni };
        arrange.validate()?;
        Ok(Box::new(arrange))
    }
}

/// The plain shadow map: one texel, one comparison (Williams 1978).
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Plain {
    /// The shadow map.
    pub map: MapConfig,
}

impl TechniqueConfig for Plain {
    fn build(&self, gpu: &Gpu) -> Result<Box<dyn Technique>, GpuError> {
        Ok(Box::new(MapTechnique::plain(gpu, &self.map)?))
    }

    fn set_map_size(&mut self, size: u32) {
        self.map.size = size;
    }

    fn map_size(&self) -> Option<u32> {
        Some(self.map.size)
    }

    fn expectation(&self, case: &str) -> Option<Expectation> {
        expectation(&self.map, &Estimator::nearest(), case)
    }
}

/// A shadow map with an estimator. One technique serves one light at a time, of any kind; the passes for a
/// kind are built when the first light of it arrives.
#[derive(Debug)]
pub struct MapTechnique {
    config: MapConfig,
    estimator: Estimator,
    map: ShadowMap,
    drawn_by: Option<CasterDepth>,
    mask: Option<ReceiverMask>,
    store: Option<Box<dyn Store>>,
    resolve: Option<(Layout, Resolve)>,
    refit: Option<Box<dyn Refit>>,
    nothing: Option<wgpu::TextureView>,
    counters: Counters,
}

impl MapTechnique {
    /// Checks the settings and makes what does not depend on the light.
    ///
    /// # Errors
    /// A size beyond the device's limits or a bias that is no number.
    pub fn new(gpu: &Gpu, config: &MapConfig, estimator: Estimator) -> Result<Self, GpuError> {
        Self::build(gpu, config, estimator, config.arrange()?, None)
    }

    /// As [`MapTechnique::new`], for an estimator that reads `store` instead of the depth map.
    ///
    /// # Errors
    /// As [`MapTechnique::new`].
    pub fn with_store(
        gpu: &Gpu,
        config: &MapConfig,
        estimator: Estimator,
        store: Box<dyn Store>,
    ) -> Result<Self, GpuError> {
        Self::build(gpu, config, estimator, config.arrange()?, Some(store))
    }

    /// As [`MapTechnique::new`], with views that `arrange` chooses and fits in the place of
    /// [`MapConfig::omni`].
    ///
    /// # Errors
    /// As [`MapTechnique::new`].
    pub fn arranged(
        gpu: &Gpu,
        config: &MapConfig,
        estimator: Estimator,
        arrange: Box<dyn Arrange>,
    ) -> Result<Self, GpuError> {
        Self::build(gpu, config, estimator, arrange, None)
    }

    /// As [`MapTechnique::arranged`], for an estimator that reads `store` instead of the depth map.
    ///
    /// # Errors
    /// As [`MapTechnique::new`].
    pub fn arranged_with_store(
        gpu: &Gpu,
        config: &MapConfig,
        estimator: Estimator,
        arrange: Box<dyn Arrange>,
        store: Box<dyn Store>,
    ) -> Result<Self, GpuError> {
        Self::build(gpu, config, estimator, arrange, Some(store))
    }

    fn build(
        gpu: &Gpu,
        config: &MapConfig,
        estimator: Estimator,
        arrange: Box<dyn Arrange>,
        store: Option<Box<dyn Store>>,
    ) -> Result<Self, GpuError> {
        config.bias.validate()?;
        if config.receiver_mask && store.is_some() {
            return Err(GpuError::Invalid {
                what: "receiver mask",
                value: "over a store made of the whole map".to_owned(),
                fix: "leave `receiver_mask` off: such a store needs all casters",
            });
        }
        // One texel more than the kernel reaches, for the rounding of a sample at the window's border.
        let guard = estimator.radius.ceil() as u32 + 1;
        let receivers = store.as_ref().is_some_and(|s| s.needs_receivers());
        let grid = store.as_ref().map_or(1, |s| s.grid());
        let map = ShadowMap::new(gpu, config.size, guard, arrange)?;
        let map = map.with_receivers(receivers).with_grid(grid);
        Ok(Self {
            config: *config,
            estimator,
            map,
            drawn_by: None,
            mask: None,
            store,
            resolve: None,
            refit: None,
            nothing: None,
            counters: Counters::new(),
        })
    }

    /// The plain shadow map: nearest texel, one comparison (Williams 1978).
    ///
    /// # Errors
    /// As [`MapTechnique::new`].
    pub fn plain(gpu: &Gpu, config: &MapConfig) -> Result<Self, GpuError> {
        Self::new(gpu, config, Estimator::nearest())
    }

    /// Has the views fitted by the arrangement that `arrange` makes of the present one: cascades and warps take it for
    /// the lights that are not theirs.
    ///
    /// # Errors
    /// That of `arrange`.
    pub fn rearranged(
        self,
        arrange: impl FnOnce(Box<dyn Arrange>) -> Result<Box<dyn Arrange>, GpuError>,
    ) -> Result<Self, GpuError> {
        Ok(Self { map: self.map.rearranged(arrange)?, resolve: None, refit: None, ..self })
    }

    /// Has the map drawn from the casters' triangles by `depth` instead of [`antumbra_gpu::Casters::draw`].
    #[must_use]
    pub fn drawn_by(mut self, depth: CasterDepth) -> Self {
        self.drawn_by = Some(depth);
        self
    }

    /// The map itself, for other uses of it.
    #[must_use]
    pub fn map(&self) -> &ShadowMap {
        &self.map
    }

    /// The pass that looks up, once a frame was prepared.
    #[must_use]
    pub fn resolve(&self) -> Option<&Resolve> {
        self.resolve.as_ref().map(|(_, resolve)| resolve)
    }

    /// What is made of the map, if anything.
    #[must_use]
    pub fn store(&self) -> Option<&dyn Store> {
        self.store.as_deref()
    }

    /// What fits the views anew, or draws them, if anything: of the last frame's light.
    #[must_use]
    pub fn refit(&self) -> Option<&dyn Refit> {
        self.refit.as_deref()
    }

    /// Whether the map is drawn in the usual way and texels are looked up within the estimator's radius alone, so that its
    /// texels may lie anywhere ([`Drawing::Pages`]).
    #[must_use]
    pub fn is_local(&self) -> bool {
        let wide = |(slot, _): &Slot| slot == "map::through" || slot == "map::shadow";
        self.drawn_by.is_none()
            && !self.store.as_ref().is_some_and(|s| s.draws())
            && !self.estimator.slots.iter().any(wide)
    }

    /// Takes note of what may be drawn of the casters, where it is masked.
    fn prepare_mask(&mut self, gpu: &Gpu, frame: &Frame<'_>) -> Result<(), GpuError> {
        let layout = self.map.arrange().layout(frame.light);
        let replaces = |slots: &[Slot], module: &str| slots.iter().any(|(slot, _)| slot == module);
        // Who replaces this module may look up more than one view, or other texels than the estimator says.
        let as_usual = !replaces(&self.estimator.slots, "map::shadow")
            && (!replaces(&layout.slots, "map::shadow")
                || replaces(&layout.slots, "map::looked_up"));
        let marked = self.config.receiver_mask && as_usual;
        let listed = marked || self.refit.as_ref().is_some_and(|refit| refit.culls());
        let drawn = self.drawn_by.is_none()
            && layout.drawing == Drawing::Matrix
            && !self.store.as_ref().is_some_and(|store| store.draws());
        let clusters = if listed && drawn { frame.casters.clusters(gpu) } else { None };
        let Some(clusters) = clusters else {
            self.mask = None;
            return Ok(());
        };
        let mask = match self.mask.take().filter(|mask| mask.serves(&layout, marked)) {
            Some(mask) => mask,
            None => {
                let radius = marked.then_some(self.estimator.radius);
                ReceiverMask::new(gpu, &layout, self.map.size(), radius)?
            }
        };
        self.mask.insert(mask).prepare(gpu, frame, &self.map, &clusters)
    }

    /// What the estimator reads: the store or else the map, or a texel of nothing where there is no caster.
    fn read(&self) -> Option<&wgpu::TextureView> {
        // A store without casters may hold what an earlier frame left: no view reads it.
        let kept = match &self.store {
            Some(store) => store.view(),
            None => self.map.view(),
        };
        kept.or(self.nothing.as_ref())
    }
}

impl Technique for MapTechnique {
    fn prepare(&mut self, gpu: &Gpu, frame: &Frame<'_>) -> Result<(), GpuError> {
        self.map.prepare(gpu, frame)?;
        let layout = self.map.arrange().layout(frame.light);
        let convention = DepthConvention::REVERSED_F32;
        if self.resolve.as_ref().is_none_or(|(kept, _)| *kept != layout) {
            self.refit = self.map.arrange().refit(gpu, frame.light)?;
            let groups = [
                self.store.as_ref().and_then(|s| s.group_layout()),
                self.refit.as_ref().and_then(|r| r.group_layout()),
            ];
            let resolve = Resolve::with_groups(gpu, &layout, &self.estimator, convention, groups)?;
            self.resolve = Some((layout, resolve));
        }
        let last_layer = self.map.linear_depths().len().saturating_sub(1);
        let mut layers = (0..).map(|layer: usize| layer.min(last_layer));
        let views: Vec<ShadowView> = self
            .map
            .views()
            .iter()
            .map(|view| match &view.clip {
                None => ShadowView::empty(view.light),
                Some(clip) => {
                    let layer = layers.next().unwrap_or_default();
                    let (bias, number) = (&self.config.bias, layer as u32);
                    ShadowView::new(clip, view.light, number, convention, bias, &self.estimator)
                        .with_linear(&self.map.linear_depths()[layer])
                }
            })
            .collect();
        if let Some((_, resolve)) = &self.resolve {
            resolve.set_views(gpu, &views)?;
        }
        if let Some(refit) = &mut self.refit {
            refit.prepare(gpu, frame, &self.map)?;
            if let Some((_, resolve)) = &mut self.resolve {
                resolve.set_layout_group(refit.group());
            }
        }
        if self.drawn_by.is_some() {
            caster_depth::triangles(frame.casters)?;
        }
        self.prepare_mask(gpu, frame)?;
        if let Some(store) = &mut self.store {
            store.prepare(gpu, frame, &self.map)?;
            if let Some((_, resolve)) = &mut self.resolve {
                resolve.set_group(store.group());
            }
        }
        // The pass needs some texture even when no view reads it.
        if self.read().is_none() {
            self.nothing = Some(one_texel(gpu, self.estimator.read)?);
        }
        Ok(())
    }

    fn encode(
        &mut self,
        gpu: &Gpu,
        frame: &Frame<'_>,
        recorder: &mut Recorder<'_>,
        visibility: &wgpu::TextureView,
    ) -> Result<(), GpuError> {
        let read = self.read().cloned();
        let (Some((layout, resolve)), Some(read)) = (&mut self.resolve, read) else {
            return Err(GpuError::Invalid {
                what: "frame",
                value: "not prepared".to_owned(),
                fix: "call `prepare` with this frame before `encode`",
            });
        };
        self.counters.clear();
        if let Some(refit) = &mut self.refit {
            refit.encode(gpu, frame, &self.map, resolve, recorder);
            self.counters.extend(refit.counters());
            self.map.set_drawn(refit.drawn());
        }
        let is_drawn =
            layout.drawing == Drawing::Pages || self.store.as_ref().is_some_and(|s| s.draws());
        if !is_drawn {
            let mask = self.mask.as_mut();
            let masked = mask.and_then(|mask| Some((mask, frame.casters.clusters(gpu)?)));
            match (&self.drawn_by, masked) {
                (Some(depth), _) => self.map.encode_triangles(frame, recorder, depth)?,
                (None, Some((mask, clusters))) => {
                    mask.encode_marks(gpu, recorder, frame.samples, resolve.views());
                    self.map.encode_masked(gpu, frame, recorder, mask, &clusters);
                }
                (None, None) => self.map.encode(frame, recorder),
            }
            self.counters.extend(self.map.counters());
        }
        if let Some(store) = &mut self.store {
            store.encode(gpu, frame, &self.map, recorder)?;
            self.counters.extend(store.counters());
        }
        resolve.encode(gpu, recorder, frame.samples, &read, visibility);
        let (width, height) = frame.samples.size();
        let samples = u64::from(width) * u64::from(height);
        self.counters.insert("view_samples", samples);
        self.counters.insert("fetches", samples * u64::from(self.estimator.fetches));
        Ok(())
    }

    fn counters(&self) -> Counters {
        self.counters.clone()
    }

    fn read_counters(&self, gpu: &Gpu) -> Result<Counters, GpuError> {
        let mut counters = self.counters();
        if let Some(mask) = &self.mask {
            counters.insert("map_triangles", mask.read_triangles(gpu)?);
        }
        if let Some(refit) = &self.refit {
            counters.extend(refit.read_counters(gpu)?);
        }
        if let Some(store) = &self.store {
            counters.extend(store.read_counters(gpu)?);
        }
        Ok(counters)
    }

    fn bytes(&self) -> u64 {
        self.map.bytes()
            + self.mask.as_ref().map_or(0, ReceiverMask::bytes)
            + self.store.as_ref().map_or(0, |s| s.bytes())
            + self.refit.as_ref().map_or(0, |r| r.bytes())
    }
}

fn one_texel(gpu: &Gpu, read: MapRead) -> Result<wgpu::TextureView, GpuError> {
    let texture = gpu.create_texture(
        "empty shadow map",
        &wgpu::TextureDescriptor {
            label: Some("empty shadow map"),
            size: wgpu::Extent3d { width: 1, height: 1, depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: match read {
                MapRead::Comparison | MapRead::Gathered | MapRead::Texels => ShadowMap::FORMAT,
                MapRead::Unsigned => wgpu::TextureFormat::R32Uint,
            },
            usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::RENDER_ATTACHMENT,
            view_formats: &[],
        },
    )?;
    Ok(texture.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::D2Array),
        ..Default::default()
    }))
}
