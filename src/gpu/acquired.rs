//! An image of the window's, between the swapchain that lends it and the work that draws on it.

use ash::vk;

/// An image that may be drawn on, until it is presented.
pub struct Acquired {
    pub(super) index: u32,
    pub(super) image: vk::Image,
    pub(super) view: vk::ImageView,
    pub(super) size: [u32; 2],
    /// What is drawn on it must be linear.
    pub(super) is_linear: bool,
    /// Signalled when the window system is done with the image.
    pub(super) free: vk::Semaphore,
    /// To be signalled when it is drawn.
    pub(super) drawn: vk::Semaphore,
}

impl Acquired {
    /// Pixels.
    pub fn size(&self) -> [u32; 2] {
        self.size
    }
}
