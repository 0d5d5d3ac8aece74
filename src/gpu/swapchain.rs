//! The images that are shown in a window.

use std::sync::Arc;

use ash::{khr, vk};

use super::acquired::Acquired;
use super::device::Gpu;
use super::error::{GpuError, Result};
use super::kinds::QueueKind;
use super::lock::lock;
use super::surface::{RawSurface, Window, no_window};

/// How long an image is waited for: a hidden window may never give one back.
const PATIENCE_NS: u64 = 100_000_000;

/// Formats of which what is written is shown as it is, those of most drivers first.
const PLAIN: [vk::Format; 4] = [
    vk::Format::B8G8R8A8_UNORM,
    vk::Format::R8G8B8A8_UNORM,
    vk::Format::A8B8G8R8_UNORM_PACK32,
    vk::Format::A2B10G10R10_UNORM_PACK32,
];
/// Formats that encode what is written.
const ENCODING: [vk::Format; 3] =
    [vk::Format::B8G8R8A8_SRGB, vk::Format::R8G8B8A8_SRGB, vk::Format::A8B8G8R8_SRGB_PACK32];

/// The format to draw in. The drawing has encoded colours, which are best blended so, as the toolkit means it: formats
/// that would encode them again come after all that do not. Other colour spaces than sRGB come last.
fn best_of(formats: &[vk::SurfaceFormatKHR]) -> Option<vk::SurfaceFormatKHR> {
    let rank = |f: &&vk::SurfaceFormatKHR| {
        let kind = PLAIN.iter().chain(&ENCODING).position(|known| *known == f.format);
        (f.color_space != vk::ColorSpaceKHR::SRGB_NONLINEAR, kind.unwrap_or(usize::MAX))
    };
    let mut best = *formats.iter().min_by_key(rank)?;
    if best.format == vk::Format::UNDEFINED {
        // Old drivers say so where any will do.
        best.format = PLAIN[0];
    }
    Some(best)
}

/// Whether colours that are written in a format are taken to be linear.
fn wants_linear(format: vk::SurfaceFormatKHR) -> bool {
    let linear = [vk::ColorSpaceKHR::EXTENDED_SRGB_LINEAR_EXT, vk::ColorSpaceKHR::BT709_LINEAR_EXT];
    ENCODING.contains(&format.format) || linear.contains(&format.color_space)
}

/// The images of one size and format.
struct Chain {
    handle: vk::SwapchainKHR,
    size: [u32; 2],
    images: Vec<(vk::Image, vk::ImageView, vk::Semaphore)>,
}

/// Images that the window shows. Made again when the window changes; no image while it is minimised.
pub struct Swapchain {
    loader: khr::swapchain::Device,
    chain: Option<Chain>,
    /// One for every frame in flight.
    free: Vec<vk::Semaphore>,
    format: vk::SurfaceFormatKHR,
    /// Of the window, pixels.
    wanted: [u32; 2],
    stale: bool,
    // The surface goes before the window and the instance do.
    surface: Option<RawSurface>,
    window: Arc<dyn Window>,
    gpu: Gpu,
}

impl Swapchain {
    /// For `window`, of `size` pixels, on a device of [`Gpu::for_window`].
    pub fn new(
        gpu: &Gpu,
        window: Arc<dyn Window>,
        size: [u32; 2],
        frames_in_flight: usize,
    ) -> Result<Swapchain> {
        let instance = &gpu.0.instance;
        let mut swapchain = Swapchain {
            loader: khr::swapchain::Device::new(&instance.handle, gpu.device()),
            chain: None,
            free: Vec::new(),
            format: vk::SurfaceFormatKHR::default(),
            wanted: size,
            stale: true,
            surface: Some(RawSurface::new(&instance.entry, &instance.handle, &*window)?),
            window,
            gpu: gpu.clone(),
        };
        for _ in 0..frames_in_flight {
            let semaphore = swapchain.semaphore("image is free")?;
            swapchain.free.push(semaphore);
        }
        let surface = swapchain.surface.as_ref().expect("just made");
        // SAFETY: device and surface are of one instance and alive.
        let formats =
            unsafe { surface.loader.get_physical_device_surface_formats(gpu.0.physical, surface.handle) }
                .map_err(|e| GpuError::vulkan("vkGetPhysicalDeviceSurfaceFormatsKHR", e))?;
        swapchain.format = best_of(&formats).ok_or_else(|| no_window("the surface has no format"))?;
        tracing::debug!("window's images: {:?}", swapchain.format);
        Ok(swapchain)
    }

    pub(super) fn format(&self) -> vk::Format {
        self.format.format
    }

    /// Whether what is drawn must be linear: the images, or the window system, encode it.
    pub(super) fn is_linear(&self) -> bool {
        wants_linear(self.format)
    }

    fn semaphore(&self, name: &str) -> Result<vk::Semaphore> {
        // SAFETY: the device is alive: `gpu` holds it.
        let semaphore =
            unsafe { self.gpu.device().create_semaphore(&vk::SemaphoreCreateInfo::default(), None) }
                .map_err(|e| GpuError::vulkan("vkCreateSemaphore for the window", e))?;
        self.gpu.name_object(semaphore, name);
        Ok(semaphore)
    }

    /// The window has that many pixels now; 0: it is minimised.
    pub fn resize(&mut self, size: [u32; 2]) {
        self.stale |= self.wanted != size;
        self.wanted = size;
    }

    /// An image to draw on in frame `slot` (see [`super::Order::begin_frame`]); `None`: there is none now, try again
    /// later.
    pub fn acquire(&mut self, slot: usize) -> Result<Option<Acquired>> {
        if self.stale && !self.make()? {
            return Ok(None);
        }
        let Some(chain) = &self.chain else { return Ok(None) };
        let free = self.free[slot];
        // SAFETY: the swapchain is alive; the frame that last waited for the semaphore is done, since its slot
        // was handed out again.
        match unsafe { self.loader.acquire_next_image(chain.handle, PATIENCE_NS, free, vk::Fence::null()) } {
            Ok((index, suboptimal)) => {
                self.stale |= suboptimal;
                let (image, view, drawn) = chain.images[index as usize];
                let is_linear = wants_linear(self.format);
                Ok(Some(Acquired { index, image, view, size: chain.size, is_linear, free, drawn }))
            }
            Err(vk::Result::TIMEOUT | vk::Result::NOT_READY) => Ok(None),
            Err(e) => self.outdated("vkAcquireNextImageKHR", e).map(|()| None),
        }
    }

    /// Shows an image, once the frame that draws on it is submitted.
    pub fn present(&mut self, image: Acquired) -> Result<()> {
        let Some(chain) = &self.chain else { return Ok(()) };
        let (waits, chains, indices) = ([image.drawn], [chain.handle], [image.index]);
        let info =
            vk::PresentInfoKHR::default().wait_semaphores(&waits).swapchains(&chains).image_indices(&indices);
        let result = {
            let _guard = lock(&self.gpu.0.submitting);
            // SAFETY: the lock makes this thread the queue's only user; the image was acquired from this chain,
            // and the semaphore's signal was submitted.
            unsafe { self.loader.queue_present(self.gpu.queue(QueueKind::Compute).handle, &info) }
        };
        match result {
            Ok(suboptimal) => {
                self.stale |= suboptimal;
                Ok(())
            }
            Err(e) => self.outdated("vkQueuePresentKHR", e),
        }
    }

    /// A change of the window is no error.
    fn outdated(&mut self, what: &str, result: vk::Result) -> Result<()> {
        match result {
            vk::Result::ERROR_OUT_OF_DATE_KHR => {}
            vk::Result::ERROR_SURFACE_LOST_KHR => {
                self.destroy_chain();
                self.surface = None;
            }
            e => return Err(GpuError::vulkan(what, e)),
        }
        self.stale = true;
        Ok(())
    }

    /// Makes the images for the window as it is now; `false` where it shows none.
    fn make(&mut self) -> Result<bool> {
        if self.wanted.contains(&0) {
            return Ok(false);
        }
        let instance = &self.gpu.0.instance;
        let surface = match &self.surface {
            Some(surface) => surface,
            None => self.surface.insert(RawSurface::new(&instance.entry, &instance.handle, &*self.window)?),
        };
        let (handle, loader) = (surface.handle, &surface.loader);
        // SAFETY: device and surface are of one instance and alive.
        let able = match unsafe {
            loader.get_physical_device_surface_capabilities(self.gpu.0.physical, handle)
        } {
            Ok(able) => able,
            Err(e) => return self.outdated("vkGetPhysicalDeviceSurfaceCapabilitiesKHR", e).map(|()| false),
        };
        let mut extent = able.current_extent;
        if extent.width == u32::MAX {
            let (low, high) = (able.min_image_extent, able.max_image_extent);
            extent.width = self.wanted[0].clamp(low.width, high.width.max(low.width));
            extent.height = self.wanted[1].clamp(low.height, high.height.max(low.height));
        }
        if extent.width == 0 || extent.height == 0 {
            return Ok(false);
        }
        let most = if able.max_image_count == 0 { u32::MAX } else { able.max_image_count };
        let opaque = vk::CompositeAlphaFlagsKHR::OPAQUE;
        let alpha = if able.supported_composite_alpha.contains(opaque) {
            opaque
        } else {
            vk::CompositeAlphaFlagsKHR::INHERIT
        };
        let create = vk::SwapchainCreateInfoKHR::default()
            .surface(handle)
            .min_image_count((able.min_image_count + 1).min(most))
            .image_format(self.format.format)
            .image_color_space(self.format.color_space)
            .image_extent(extent)
            .image_array_layers(1)
            .image_usage(vk::ImageUsageFlags::COLOR_ATTACHMENT)
            .pre_transform(able.current_transform)
            .composite_alpha(alpha)
            .present_mode(vk::PresentModeKHR::FIFO)
            .clipped(true);
        let old = self.chain.as_ref().map_or(vk::SwapchainKHR::null(), |chain| chain.handle);
        // SAFETY: the surface is alive, and its only swapchain is the old one.
        let made = unsafe { self.loader.create_swapchain(&create.old_swapchain(old), None) };
        self.destroy_chain();
        let made = match made {
            Ok(made) => made,
            Err(e) => return self.outdated("vkCreateSwapchainKHR", e).map(|()| false),
        };
        // In place before what may fail, so that Drop gives it back.
        let chain = Chain { handle: made, size: [extent.width, extent.height], images: Vec::new() };
        self.chain = Some(chain);
        // SAFETY: the swapchain was just made.
        let images = unsafe { self.loader.get_swapchain_images(made) }
            .map_err(|e| GpuError::vulkan("vkGetSwapchainImagesKHR", e))?;
        for image in images {
            let whole = vk::ImageSubresourceRange::default()
                .aspect_mask(vk::ImageAspectFlags::COLOR)
                .level_count(1)
                .layer_count(1);
            let create = vk::ImageViewCreateInfo::default()
                .image(image)
                .view_type(vk::ImageViewType::TYPE_2D)
                .format(self.format.format)
                .subresource_range(whole);
            // SAFETY: the image is the swapchain's, which is alive.
            let view = unsafe { self.gpu.device().create_image_view(&create, None) }
                .map_err(|e| GpuError::vulkan("vkCreateImageView", e))?;
            let drawn = self.semaphore("image is drawn")?;
            self.chain.as_mut().expect("just made").images.push((image, view, drawn));
        }
        self.stale = false;
        Ok(true)
    }

    fn destroy_chain(&mut self) {
        let Some(chain) = self.chain.take() else { return };
        self.gpu.wait_idle();
        // SAFETY: the device is idle, so nothing uses the images, their views or semaphores.
        unsafe {
            for (_, view, drawn) in chain.images {
                self.gpu.device().destroy_image_view(view, None);
                self.gpu.device().destroy_semaphore(drawn, None);
            }
            self.loader.destroy_swapchain(chain.handle, None);
        }
    }
}

impl Drop for Swapchain {
    fn drop(&mut self) {
        self.gpu.wait_idle();
        self.destroy_chain();
        for semaphore in self.free.drain(..) {
            // SAFETY: the device is idle.
            unsafe { self.gpu.device().destroy_semaphore(semaphore, None) };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vk::{ColorSpaceKHR as Space, Format};

    fn format(format: Format, color_space: Space) -> vk::SurfaceFormatKHR {
        vk::SurfaceFormatKHR { format, color_space }
    }

    fn chosen(formats: &[(Format, Space)]) -> Option<(Format, bool)> {
        let formats: Vec<_> = formats.iter().map(|&(f, s)| format(f, s)).collect();
        best_of(&formats).map(|best| (best.format, wants_linear(best)))
    }

    #[test]
    fn colours_are_encoded_once() {
        let srgb = Space::SRGB_NONLINEAR;
        // Whatever is listed first.
        let both = [(Format::B8G8R8A8_SRGB, srgb), (Format::R8G8B8A8_UNORM, srgb)];
        assert_eq!(chosen(&both), Some((Format::R8G8B8A8_UNORM, false)));
        // Ten bits before those that encode, eight bits before ten.
        let ten = (Format::A2B10G10R10_UNORM_PACK32, srgb);
        assert_eq!(chosen(&[both[0], ten]), Some((ten.0, false)));
        assert_eq!(chosen(&[ten, both[1]]), Some((Format::R8G8B8A8_UNORM, false)));
        // Where there is no other, what is written is linear.
        assert_eq!(chosen(&both[..1]), Some((Format::B8G8R8A8_SRGB, true)));
        assert_eq!(chosen(&[(Format::R8G8B8A8_SRGB, srgb)]), Some((Format::R8G8B8A8_SRGB, true)));
        let float = (Format::R16G16B16A16_SFLOAT, Space::EXTENDED_SRGB_LINEAR_EXT);
        assert_eq!(chosen(&[float]), Some((float.0, true)));
        // Another colour space would show other colours.
        let wide = (Format::B8G8R8A8_UNORM, Space::DISPLAY_P3_NONLINEAR_EXT);
        assert_eq!(chosen(&[wide, float, both[0]]), Some((Format::B8G8R8A8_SRGB, true)));
        assert_eq!(chosen(&[(Format::UNDEFINED, srgb)]), Some((Format::B8G8R8A8_UNORM, false)));
        assert_eq!(chosen(&[]), None);
    }
}
