//! What can go wrong between this layer and the driver.

use std::time::Duration;

use super::kinds::MemoryKind;

/// What can go wrong between here and the driver.
#[derive(Debug, thiserror::Error)]
pub enum GpuError {
    /// The Vulkan loader library is not there.
    #[error("no Vulkan loader ({reason}): {}", INSTALL_HINT)]
    NoLoader {
        /// What the system said.
        reason: String,
    },
    /// The loader found no driver, or a driver no device.
    #[error("no Vulkan device: {}", INSTALL_HINT)]
    NoDevice,
    /// No device has all that is needed.
    #[error("no Vulkan device can be used:\n{listing}")]
    NoUsableDevice {
        /// One line a device: what it lacks.
        listing: String,
    },
    /// `--device N` names none.
    #[error("there is no device {index}; the devices are:\n{listing}")]
    NoSuchDevice {
        /// What was asked for.
        index: usize,
        /// One line a device.
        listing: String,
    },
    /// The chosen device lacks something.
    #[error("device {index} ({name}) lacks {missing}")]
    Unsuitable {
        /// Index as listed.
        index: usize,
        /// The driver's name for it.
        name: String,
        /// What it lacks.
        missing: String,
    },
    /// A layer was asked for that is not installed.
    #[error("the Vulkan layer {name} is not installed{hint}")]
    NoLayer {
        /// Layer name.
        name: String,
        /// What to install.
        hint: &'static str,
    },
    /// Images cannot be shown in the window.
    #[error("no window: {reason}")]
    NoWindow {
        /// Why.
        reason: String,
    },
    /// A Vulkan call failed.
    #[error("{what}: {result}")]
    Vulkan {
        /// The call or object.
        what: String,
        /// What the driver answered.
        result: ash::vk::Result,
    },
    /// Memory ran out.
    #[error("no {bytes} bytes of {kind} memory for {name}: {reason}")]
    Memory {
        /// The buffer's name.
        name: String,
        /// Kind of memory.
        kind: MemoryKind,
        /// What was asked for.
        bytes: u64,
        /// What the allocator said.
        reason: String,
    },
    /// The driver gave up on the device.
    #[error("the device was lost ({what}); a driver reset or a crash in the driver does this")]
    DeviceLost {
        /// The call that noticed.
        what: String,
    },
    /// The device did not finish in time.
    #[error("{what} was not done after {after:?}")]
    Timeout {
        /// What was waited for.
        what: String,
        /// How long.
        after: Duration,
    },
}

/// What to do where no driver is found.
const INSTALL_HINT: &str = "install a driver for your GPU, or a software one \
    (Debian, Ubuntu: `apt install libvulkan1 mesa-vulkan-drivers`; \
    Fedora: `dnf install vulkan-loader mesa-vulkan-drivers`; macOS: `brew install molten-vk vulkan-loader`)";

impl GpuError {
    pub(super) fn vulkan(what: impl Into<String>, result: ash::vk::Result) -> GpuError {
        let what = what.into();
        match result {
            ash::vk::Result::ERROR_DEVICE_LOST => GpuError::DeviceLost { what },
            result => GpuError::Vulkan { what, result },
        }
    }
}

/// Shorthand of this layer.
pub type Result<T> = std::result::Result<T, GpuError>;
