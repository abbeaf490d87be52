//! What can go wrong between a technique and the device.

/// An error of the GPU context or of a technique's set-up. Every message says the fix.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum GpuError {
    /// No adapter matches the request.
    #[error(
        "no GPU adapter{wanted}; install a Vulkan driver (on Debian or Ubuntu: \
         apt-get install libvulkan1 mesa-vulkan-drivers){found}"
    )]
    NoAdapter {
        /// What was asked for, or an empty string.
        wanted: String,
        /// The adapters there are, or an empty string.
        found: String,
    },
    /// The adapter gave no device.
    #[error("the adapter `{adapter}` gave no device: {reason}")]
    NoDevice {
        /// Name of the adapter.
        adapter: String,
        /// The driver's words.
        reason: String,
    },
    /// A size lies beyond what the device offers.
    #[error("{what}: {asked} is beyond this device's limit of {limit}; use at most {limit}")]
    Limit {
        /// The quantity.
        what: &'static str,
        /// The value asked for.
        asked: u64,
        /// The largest value possible.
        limit: u64,
    },
    /// A value of a config or an input is unusable.
    #[error("{what}: {value} is not usable; {fix}")]
    Invalid {
        /// The field or input.
        what: &'static str,
        /// Its value, as text.
        value: String,
        /// What to use instead.
        fix: &'static str,
    },
    /// The device lacks an optional feature.
    #[error(
        "{what} needs the device feature {feature}; create the device with it or choose {instead}"
    )]
    MissingFeature {
        /// Who needs it.
        what: &'static str,
        /// Name of the feature.
        feature: String,
        /// The way without it.
        instead: &'static str,
    },
    /// The device ran out of memory.
    #[error("the device has no memory left for {what} ({bytes} bytes); use a smaller size")]
    OutOfMemory {
        /// What was to be allocated.
        what: &'static str,
        /// Its size.
        bytes: u64,
    },
    /// The device is gone.
    #[error("the device was lost ({reason}); create a new one and build the techniques anew")]
    DeviceLost {
        /// The driver's words.
        reason: String,
    },
    /// wgpu refused a call: a fault of this library or of a caller's resource.
    #[error("wgpu validation: {0}")]
    Validation(String),
    /// A shader does not link; a fault of this library or of a caller's estimator.
    #[error("{0}")]
    Shader(String),
}

impl From<antumbra_shaders::LinkError> for GpuError {
    fn from(error: antumbra_shaders::LinkError) -> Self {
        Self::Shader(error.to_string())
    }
}
