//! The surface of a window: what it asks of the instance and of a device, before there is a device.

use std::ffi::CStr;

use ash::{khr, vk};
use raw_window_handle::{HasDisplayHandle, HasWindowHandle};

use super::error::{GpuError, Result};

/// A window of the system.
pub trait Window: HasWindowHandle + HasDisplayHandle + Send + Sync {}

impl<T: HasWindowHandle + HasDisplayHandle + Send + Sync> Window for T {}

/// The error of a window that cannot be drawn in.
pub(super) fn no_window(reason: impl ToString) -> GpuError {
    GpuError::NoWindow { reason: reason.to_string() }
}

/// What the instance must offer for images in `window`.
pub(super) fn instance_extensions(window: &dyn Window) -> Result<Vec<&'static CStr>> {
    let display = window.display_handle().map_err(no_window)?;
    let names = ash_window::enumerate_required_extensions(display.as_raw()).map_err(no_window)?;
    // SAFETY: the names are constants of the bindings.
    Ok(names.iter().map(|&name| unsafe { CStr::from_ptr(name) }).collect())
}

/// A surface alone, while a device is chosen by it. Goes before its instance and its window.
pub(super) struct RawSurface {
    pub loader: khr::surface::Instance,
    pub handle: vk::SurfaceKHR,
}

impl RawSurface {
    pub fn new(entry: &ash::Entry, instance: &ash::Instance, window: &dyn Window) -> Result<RawSurface> {
        let display = window.display_handle().map_err(no_window)?.as_raw();
        let handle = window.window_handle().map_err(no_window)?.as_raw();
        // SAFETY: the handles are of a window that is alive: it is borrowed, and whoever keeps the surface
        // keeps the window.
        let handle = unsafe { ash_window::create_surface(entry, instance, display, handle, None) }
            .map_err(|e| GpuError::vulkan("vkCreateSurfaceKHR", e))?;
        Ok(RawSurface { loader: khr::surface::Instance::new(entry, instance), handle })
    }

    /// Which families of a device draw, compute and show images here.
    pub fn families(&self, instance: &ash::Instance, physical: vk::PhysicalDevice) -> Vec<bool> {
        // SAFETY: the device was enumerated from this instance.
        let families = unsafe { instance.get_physical_device_queue_family_properties(physical) };
        let all = vk::QueueFlags::GRAPHICS | vk::QueueFlags::COMPUTE;
        let shows = |family: u32| {
            // SAFETY: the device was enumerated from the surface's instance, and the family is one of its own.
            unsafe { self.loader.get_physical_device_surface_support(physical, family, self.handle) }
        };
        (0..).zip(&families).map(|(k, f)| f.queue_flags.contains(all) && shows(k).unwrap_or(false)).collect()
    }

    /// What a device lacks to show images here.
    pub fn missing(&self, instance: &ash::Instance, physical: vk::PhysicalDevice) -> Vec<&'static str> {
        // SAFETY: the device was enumerated from this instance.
        let extensions = unsafe { instance.enumerate_device_extension_properties(physical) };
        let is_swapchain =
            |e: &vk::ExtensionProperties| e.extension_name_as_c_str() == Ok(khr::swapchain::NAME);
        let mut missing = Vec::new();
        if !extensions.unwrap_or_default().iter().any(is_swapchain) {
            missing.push("VK_KHR_swapchain");
        }
        if !self.families(instance, physical).contains(&true) {
            missing.push("a queue that shows pictures in this window");
        }
        missing
    }
}

impl Drop for RawSurface {
    fn drop(&mut self) {
        // SAFETY: its instance is alive, and no swapchain is left: both are dropped later and earlier.
        unsafe { self.loader.destroy_surface(self.handle, None) };
    }
}
