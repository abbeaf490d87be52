//! The device and its queue, own or borrowed.

use std::sync::{Arc, Mutex};

use crate::GpuError;

/// How to choose an adapter for an own device.
#[derive(Clone, Debug, Default)]
pub struct GpuOptions {
    /// Part of the adapter's name, in any case (`"llvmpipe"`). `None`: the environment variable
    /// `WGPU_ADAPTER_NAME` if set, else the most capable adapter, else a software one.
    pub adapter: Option<String>,
}

/// A device with its queue, and what is known about it. Cheap to clone.
#[derive(Clone, Debug)]
pub struct Gpu {
    /// The device.
    pub device: wgpu::Device,
    /// Its queue.
    pub queue: wgpu::Queue,
    /// What the driver says about the adapter.
    pub info: wgpu::AdapterInfo,
    faults: Arc<Mutex<Vec<GpuError>>>,
}

/// Optional features that are used where present, only to measure or to be faster.
const OPTIONAL_FEATURES: wgpu::Features = wgpu::Features::TIMESTAMP_QUERY
    .union(wgpu::Features::DEPTH_CLIP_CONTROL)
    .union(wgpu::Features::FLOAT32_FILTERABLE);

impl Gpu {
    /// Creates an own device: WebGPU's default limits, raised only in texture size and buffer size to
    /// what the adapter has.
    ///
    /// Errors that wgpu reports later are kept for [`Gpu::check`] instead of a panic.
    ///
    /// # Errors
    /// [`GpuError::NoAdapter`] or [`GpuError::NoDevice`].
    pub fn new(options: &GpuOptions) -> Result<Self, GpuError> {
        let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle_from_env();
        descriptor.backend_options.gl.debug_fns = wgpu::GlDebugFns::Disabled;
        let instance = wgpu::Instance::new(descriptor);
        let adapter = choose_adapter(&instance, options)?;
        let info = adapter.get_info();
        let offered = adapter.limits();
        let limits = wgpu::Limits {
            max_texture_dimension_2d: offered.max_texture_dimension_2d,
            max_buffer_size: offered.max_buffer_size,
            max_storage_buffer_binding_size: offered.max_storage_buffer_binding_size,
            ..wgpu::Limits::default()
        };
        let (device, queue) = pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor {
            label: Some("antumbra"),
            required_features: adapter.features() & OPTIONAL_FEATURES,
            required_limits: limits,
            ..Default::default()
        }))
        .map_err(|e| GpuError::NoDevice { adapter: info.name.clone(), reason: e.to_string() })?;
        let gpu = Self { device, queue, info, faults: Arc::default() };
        gpu.keep_faults();
        Ok(gpu)
    }

    /// Uses the caller's device. Its error handlers stay as they are; [`Gpu::check`] then knows
    /// nothing.
    #[must_use]
    pub fn from_device(device: wgpu::Device, queue: wgpu::Queue) -> Self {
        let info = device.adapter_info();
        Self { device, queue, info, faults: Arc::default() }
    }

    /// The first error that wgpu reported since the last call, if any; the others are dropped with it.
    ///
    /// # Errors
    /// That error.
    pub fn check(&self) -> Result<(), GpuError> {
        let mut faults = self.faults.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        let first = faults.drain(..).next();
        first.map_or(Ok(()), Err)
    }

    /// Waits until everything submitted so far has run. For tests and measurements; a technique never
    /// calls it.
    ///
    /// # Errors
    /// [`GpuError::DeviceLost`], or an error reported since the last check.
    pub fn wait(&self) -> Result<(), GpuError> {
        self.device
            .poll(wgpu::PollType::wait_indefinitely())
            .map_err(|e| GpuError::DeviceLost { reason: e.to_string() })?;
        self.check()
    }

    /// Makes a texture after checking its size and catching a failed allocation.
    ///
    /// # Errors
    /// [`GpuError::Limit`], [`GpuError::Invalid`] for an empty size, [`GpuError::OutOfMemory`].
    pub fn create_texture(
        &self,
        what: &'static str,
        descriptor: &wgpu::TextureDescriptor<'_>,
    ) -> Result<wgpu::Texture, GpuError> {
        let limits = self.device.limits();
        let size = descriptor.size;
        let side = size.width.max(size.height);
        if size.width == 0 || size.height == 0 || size.depth_or_array_layers == 0 {
            let value = format!("{}x{}", size.width, size.height);
            return Err(GpuError::Invalid { what, value, fix: "use a size of at least 1x1" });
        }
        for (asked, limit) in [
            (side, limits.max_texture_dimension_2d),
            (size.depth_or_array_layers, limits.max_texture_array_layers),
        ] {
            if asked > limit {
                return Err(GpuError::Limit { what, asked: asked.into(), limit: limit.into() });
            }
        }
        let scope = self.device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
        let texture = self.device.create_texture(descriptor);
        match pollster::block_on(scope.pop()) {
            None => Ok(texture),
            Some(_) => {
                let texel = descriptor.format.block_copy_size(None).unwrap_or(4);
                let texels = u64::from(size.width)
                    * u64::from(size.height)
                    * u64::from(size.depth_or_array_layers);
                Err(GpuError::OutOfMemory { what, bytes: texels * u64::from(texel) })
            }
        }
    }

    /// Makes a buffer with `contents`, a multiple of four bytes and not empty. Unlike wgpu's own helper it
    /// does not panic on a lost device.
    #[must_use]
    pub fn buffer(&self, label: &str, contents: &[u8], usage: wgpu::BufferUsages) -> wgpu::Buffer {
        let buffer = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some(label),
            size: contents.len() as u64,
            usage: usage | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        self.queue.write_buffer(&buffer, 0, contents);
        buffer
    }

    /// Compiles linked WGSL.
    #[must_use]
    pub fn shader(&self, label: &str, wgsl: String) -> wgpu::ShaderModule {
        self.device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some(label),
            source: wgpu::ShaderSource::Wgsl(wgsl.into()),
        })
    }

    /// Makes the compute pipeline of one entry point, whose bind groups are `groups`.
    #[must_use]
    pub fn compute_pipeline(
        &self,
        label: &str,
        module: &wgpu::ShaderModule,
        entry_point: &str,
        groups: &[&wgpu::BindGroupLayout],
    ) -> wgpu::ComputePipeline {
        let groups: Vec<_> = groups.iter().copied().map(Some).collect();
        let layout = self.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some(label),
            bind_group_layouts: &groups,
            immediate_size: 0,
        });
        self.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some(label),
            layout: Some(&layout),
            module,
            entry_point: Some(entry_point),
            compilation_options: Default::default(),
            cache: None,
        })
    }

    fn keep_faults(&self) {
        let faults = Arc::clone(&self.faults);
        let keep = move |fault| {
            faults.lock().unwrap_or_else(std::sync::PoisonError::into_inner).push(fault);
        };
        let lost = keep.clone();
        self.device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            keep(match error {
                wgpu::Error::OutOfMemory { .. } => {
                    GpuError::OutOfMemory { what: "a resource", bytes: 0 }
                }
                other => GpuError::Validation(other.to_string()),
            });
        }));
        self.device.set_device_lost_callback(move |reason, message| {
            if reason != wgpu::DeviceLostReason::Destroyed {
                lost(GpuError::DeviceLost { reason: message });
            }
        });
    }
}

/// The adapter asked for by option or environment; else the most capable, software last.
fn choose_adapter(
    instance: &wgpu::Instance,
    options: &GpuOptions,
) -> Result<wgpu::Adapter, GpuError> {
    let wanted = options.adapter.clone().or_else(|| std::env::var("WGPU_ADAPTER_NAME").ok());
    let mut adapters = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::all()));
    // GL reports the same hardware again, with less: only when nothing else is there.
    adapters.sort_by_key(|a| {
        let info = a.get_info();
        let kind = match info.device_type {
            wgpu::DeviceType::DiscreteGpu => 0,
            wgpu::DeviceType::IntegratedGpu => 1,
            wgpu::DeviceType::VirtualGpu => 2,
            wgpu::DeviceType::Other => 3,
            wgpu::DeviceType::Cpu => 4,
        };
        (info.backend == wgpu::Backend::Gl, kind)
    });
    let names: Vec<String> = adapters.iter().map(|a| a.get_info().name).collect();
    let matches = |name: &str| {
        wanted.as_ref().is_none_or(|w| name.to_lowercase().contains(&w.to_lowercase()))
    };
    adapters.into_iter().find(|a| matches(&a.get_info().name)).ok_or_else(|| GpuError::NoAdapter {
        wanted: wanted.map(|w| format!(" whose name contains `{w}`")).unwrap_or_default(),
        found: if names.is_empty() {
            String::new()
        } else {
            format!("; there are: {}", names.join(", "))
        },
    })
}
