//! A Vulkan device, as `lasray info --devices --json` gives it.

use crate::gpu::DeviceInfo;
use serde::Serialize;

/// A device, as `--json` gives it.
#[derive(Debug, Serialize)]
pub(super) struct DeviceReport<'a> {
    /// What `--device` takes.
    index: usize,
    name: &'a str,
    kind: String,
    driver: &'a str,
    /// Vulkan version.
    api: String,
    memory_bytes: u64,
    /// Empty for a device that can be used.
    missing: &'a [&'static str],
}

impl DeviceReport<'_> {
    pub fn of(device: &DeviceInfo) -> DeviceReport<'_> {
        let [major, minor, patch] = device.api;
        DeviceReport {
            index: device.index,
            name: &device.name,
            kind: device.kind.to_string(),
            driver: &device.driver,
            api: format!("{major}.{minor}.{patch}"),
            memory_bytes: device.memory_bytes,
            missing: &device.missing,
        }
    }
}
