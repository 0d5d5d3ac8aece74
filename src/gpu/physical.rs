//! Physical devices: what the driver says of each, what it lacks, and which one is taken.

use std::ffi::CStr;
use std::fmt;

use ash::vk;

use super::error::{GpuError, Result};
use super::instance::Instance;

/// What sort of processor a device is; the first is preferred.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum DeviceKind {
    /// A graphics card.
    Discrete,
    /// Shares the host's memory.
    Integrated,
    /// A graphics card lent to a virtual machine.
    Virtual,
    /// A software driver.
    Cpu,
    /// Anything else.
    Other,
}

impl fmt::Display for DeviceKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            DeviceKind::Discrete => "discrete",
            DeviceKind::Integrated => "integrated",
            DeviceKind::Virtual => "virtual",
            DeviceKind::Cpu => "cpu",
            DeviceKind::Other => "other",
        })
    }
}

/// A device as the driver describes it.
#[derive(Clone, Debug)]
pub struct DeviceInfo {
    /// What `--device` takes.
    pub index: usize,
    /// The driver's name for it.
    pub name: String,
    /// Discrete, integrated, ...
    pub kind: DeviceKind,
    /// Driver name and version.
    pub driver: String,
    /// Vulkan version of the device: major, minor, patch.
    pub api: [u32; 3],
    /// Bytes of its device-local memory.
    pub memory_bytes: u64,
    /// What it lacks; empty for a device that can be used.
    pub missing: Vec<&'static str>,
}

impl fmt::Display for DeviceInfo {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [major, minor, patch] = self.api;
        let mib = self.memory_bytes >> 20;
        write!(
            f,
            "{}: {} ({}, {}, Vulkan {major}.{minor}.{patch}, {mib} MiB)",
            self.index, self.name, self.kind, self.driver
        )?;
        if !self.missing.is_empty() {
            write!(f, ", lacks {}", self.missing.join(", "))?;
        }
        Ok(())
    }
}

impl DeviceInfo {
    /// The error of a device that was chosen and lacks something.
    pub(super) fn unsuitable(self) -> GpuError {
        let DeviceInfo { index, name, missing, .. } = self;
        GpuError::Unsuitable { index, name, missing: missing.join(", ") }
    }
}

/// What a device can do at most, of what is asked of it here.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// Largest range of one storage buffer binding, bytes.
    pub storage_buffer_range: u64,
    /// Most texels of a buffer seen as such.
    pub texels: u32,
    /// Largest single buffer, bytes.
    pub buffer_bytes: u64,
    /// Largest single allocation, bytes.
    pub allocation_bytes: u64,
    /// Workgroups in x, y, z of one dispatch.
    pub workgroups: [u32; 3],
    /// Invocations in one workgroup.
    pub workgroup_size: u32,
    /// Nanoseconds of one timestamp step.
    pub timestamp_ns: f64,
    /// How many low bits of a timestamp count on the compute and on the transfer queue; 0 where there are none.
    pub timestamp_bits: [u32; 2],
}

/// `families`: of the compute and of the transfer queue.
pub(super) fn limits(
    instance: &ash::Instance,
    physical: vk::PhysicalDevice,
    families: [&vk::QueueFamilyProperties; 2],
) -> Limits {
    let mut p11 = vk::PhysicalDeviceVulkan11Properties::default();
    let mut p13 = vk::PhysicalDeviceVulkan13Properties::default();
    let mut properties = vk::PhysicalDeviceProperties2::default().push_next(&mut p11).push_next(&mut p13);
    // SAFETY: a 1.3 device knows both structs, which are alive in this scope.
    unsafe { instance.get_physical_device_properties2(physical, &mut properties) };
    let limits = properties.properties.limits;
    Limits {
        storage_buffer_range: u64::from(limits.max_storage_buffer_range),
        texels: limits.max_texel_buffer_elements,
        buffer_bytes: p13.max_buffer_size,
        allocation_bytes: p11.max_memory_allocation_size,
        workgroups: limits.max_compute_work_group_count,
        workgroup_size: limits.max_compute_work_group_invocations,
        timestamp_bits: families.map(|family| family.timestamp_valid_bits),
        timestamp_ns: f64::from(limits.timestamp_period),
    }
}

fn device_info(instance: &ash::Instance, physical: vk::PhysicalDevice, index: usize) -> DeviceInfo {
    // SAFETY: `physical` was enumerated from `instance`.
    let (properties, memory) = unsafe {
        (
            instance.get_physical_device_properties(physical),
            instance.get_physical_device_memory_properties(physical),
        )
    };
    let version = properties.api_version;
    let mut driver = vk::PhysicalDeviceDriverProperties::default();
    if version >= vk::API_VERSION_1_2 {
        let mut chain = vk::PhysicalDeviceProperties2::default().push_next(&mut driver);
        // SAFETY: a 1.2 device knows the struct, which is alive in this scope.
        unsafe { instance.get_physical_device_properties2(physical, &mut chain) };
    }
    let text =
        |s: std::result::Result<&CStr, _>| s.map_or(String::new(), |s| s.to_string_lossy().into_owned());
    let driver = format!("{} {}", text(driver.driver_name_as_c_str()), text(driver.driver_info_as_c_str()));
    DeviceInfo {
        index,
        name: text(properties.device_name_as_c_str()),
        kind: match properties.device_type {
            vk::PhysicalDeviceType::DISCRETE_GPU => DeviceKind::Discrete,
            vk::PhysicalDeviceType::INTEGRATED_GPU => DeviceKind::Integrated,
            vk::PhysicalDeviceType::VIRTUAL_GPU => DeviceKind::Virtual,
            vk::PhysicalDeviceType::CPU => DeviceKind::Cpu,
            _ => DeviceKind::Other,
        },
        driver: driver.trim().to_owned(),
        api: [vk::api_version_major(version), vk::api_version_minor(version), vk::api_version_patch(version)],
        memory_bytes: memory
            .memory_heaps_as_slice()
            .iter()
            .filter(|h| h.flags.contains(vk::MemoryHeapFlags::DEVICE_LOCAL))
            .map(|h| h.size)
            .sum(),
        missing: Features::of(instance, physical).missing,
    }
}

/// Which families and queues serve compute and transfer.
#[derive(Debug, PartialEq)]
pub(super) struct QueuePlan {
    pub compute: u32,
    /// Family and index in it.
    pub transfer: Option<(u32, u32)>,
}

impl QueuePlan {
    /// `presents`: whether a family computes, draws and shows images; `None` where that does not matter.
    pub fn of(
        families: &[vk::QueueFamilyProperties],
        presents: impl Fn(u32) -> Option<bool>,
    ) -> Option<QueuePlan> {
        let find = |wanted: vk::QueueFlags, unwanted: vk::QueueFlags| {
            families
                .iter()
                .position(|f| {
                    f.queue_count > 0 && f.queue_flags.contains(wanted) && !f.queue_flags.intersects(unwanted)
                })
                .map(|i| i as u32)
        };
        let none = vk::QueueFlags::empty();
        let (compute_flag, graphics) = (vk::QueueFlags::COMPUTE, vk::QueueFlags::GRAPHICS);
        let mut all = 0..families.len() as u32;
        let compute = if all.clone().any(|family| presents(family).is_some()) {
            all.find(|&family| presents(family) == Some(true))?
        } else {
            // A family that also draws can present.
            find(compute_flag | graphics, none).or_else(|| find(compute_flag, none))?
        };
        let video = vk::QueueFlags::VIDEO_DECODE_KHR | vk::QueueFlags::VIDEO_ENCODE_KHR;
        let transfer =
            find(vk::QueueFlags::TRANSFER, compute_flag | graphics | video).map(|family| (family, 0));
        let second = (families[compute as usize].queue_count > 1).then_some((compute, 1));
        Some(QueuePlan { compute, transfer: transfer.or(second) })
    }
}

/// Features that a device offers; all that are needed must be enabled.
pub(super) struct Features {
    pub host_query_reset: bool,
    pub pipeline_executable_info: bool,
    missing: Vec<&'static str>,
}

impl Features {
    pub fn of(instance: &ash::Instance, physical: vk::PhysicalDevice) -> Features {
        // SAFETY: `physical` was enumerated from `instance`.
        let version = unsafe { instance.get_physical_device_properties(physical) }.api_version;
        if version < vk::API_VERSION_1_3 {
            return Features {
                host_query_reset: false,
                pipeline_executable_info: false,
                missing: vec!["Vulkan 1.3"],
            };
        }
        let mut f12 = vk::PhysicalDeviceVulkan12Features::default();
        let mut f13 = vk::PhysicalDeviceVulkan13Features::default();
        // Of an extension: drivers without it leave the struct as it is.
        let mut executables = vk::PhysicalDevicePipelineExecutablePropertiesFeaturesKHR::default();
        let mut features = vk::PhysicalDeviceFeatures2::default()
            .push_next(&mut f12)
            .push_next(&mut f13)
            .push_next(&mut executables);
        // SAFETY: a 1.3 device knows the first two structs; all are alive in this scope.
        unsafe { instance.get_physical_device_features2(physical, &mut features) };
        let wanted = [
            (f12.timeline_semaphore, "timelineSemaphore"),
            (f12.buffer_device_address, "bufferDeviceAddress"),
            (f12.scalar_block_layout, "scalarBlockLayout"),
            (f13.synchronization2, "synchronization2"),
            (f13.maintenance4, "maintenance4"),
        ];
        let missing = wanted.into_iter().filter(|(has, _)| *has == vk::FALSE).map(|(_, name)| name).collect();
        Features {
            host_query_reset: f12.host_query_reset == vk::TRUE,
            pipeline_executable_info: executables.pipeline_executable_info == vk::TRUE,
            missing,
        }
    }
}

fn listing<'a>(devices: impl Iterator<Item = &'a DeviceInfo>) -> String {
    devices.map(|d| format!("  {d}")).collect::<Vec<_>>().join("\n")
}

/// The devices of an instance in its order, usable or not.
pub(super) fn devices(instance: &Instance) -> Result<Vec<(vk::PhysicalDevice, DeviceInfo)>> {
    // SAFETY: the instance is alive.
    let list = match unsafe { instance.handle.enumerate_physical_devices() } {
        Ok(list) => list,
        Err(vk::Result::ERROR_INITIALIZATION_FAILED) => return Err(GpuError::NoDevice),
        Err(e) => return Err(GpuError::vulkan("vkEnumeratePhysicalDevices", e)),
    };
    Ok(list
        .into_iter()
        .enumerate()
        .map(|(i, physical)| (physical, device_info(&instance.handle, physical, i)))
        .collect())
}

/// Lists what the loader finds, usable or not.
pub fn list_devices() -> Result<Vec<DeviceInfo>> {
    let instance = Instance::new(false, &[], &[])?;
    Ok(devices(&instance)?.into_iter().map(|(_, info)| info).collect())
}

/// The device of index `wanted`, or else the best that can be used: discrete, integrated, virtual, CPU.
pub(super) fn choose(
    devices: &[(vk::PhysicalDevice, DeviceInfo)],
    wanted: Option<usize>,
) -> Result<(vk::PhysicalDevice, DeviceInfo)> {
    if devices.is_empty() {
        return Err(GpuError::NoDevice);
    }
    let listing = || listing(devices.iter().map(|(_, d)| d));
    let chosen = match wanted {
        Some(index) => {
            devices.get(index).ok_or_else(|| GpuError::NoSuchDevice { index, listing: listing() })?
        }
        None => devices
            .iter()
            .filter(|(_, d)| d.missing.is_empty())
            .min_by_key(|(_, d)| (d.kind, d.index))
            .ok_or_else(|| GpuError::NoUsableDevice { listing: listing() })?,
    };
    let (physical, info) = chosen.clone();
    if info.missing.is_empty() { Ok((physical, info)) } else { Err(info.unsuitable()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn family(flags: vk::QueueFlags, count: u32) -> vk::QueueFamilyProperties {
        vk::QueueFamilyProperties { queue_flags: flags, queue_count: count, ..Default::default() }
    }

    #[test]
    fn queues_are_picked_from_what_a_device_has() {
        use vk::QueueFlags as F;
        let all = F::GRAPHICS | F::COMPUTE | F::TRANSFER;
        let plan = |families: &[vk::QueueFamilyProperties]| QueuePlan::of(families, |_| None);
        assert_eq!(plan(&[family(F::TRANSFER, 1)]), None);
        assert_eq!(plan(&[family(all, 1)]), Some(QueuePlan { compute: 0, transfer: None }));
        assert_eq!(plan(&[family(all, 16)]), Some(QueuePlan { compute: 0, transfer: Some((0, 1)) }));
        // An async compute family is not a transfer family; the copy engine is.
        let nvidia = [family(all, 16), family(F::TRANSFER, 2), family(F::COMPUTE | F::TRANSFER, 8)];
        assert_eq!(plan(&nvidia), Some(QueuePlan { compute: 0, transfer: Some((1, 0)) }));
        // Compute comes first where it is listed first, but the family that can present is taken.
        let odd = [family(F::COMPUTE, 1), family(all, 1)];
        assert_eq!(plan(&odd), Some(QueuePlan { compute: 1, transfer: None }));
        assert_eq!(plan(&[family(F::COMPUTE, 1)]), Some(QueuePlan { compute: 0, transfer: None }));
        // For a window, the family that shows images.
        let window = |families: &[vk::QueueFamilyProperties]| QueuePlan::of(families, |f| Some(f == 1));
        assert_eq!(window(&[family(all, 1)]), None);
        let shown = Some(QueuePlan { compute: 1, transfer: None });
        assert_eq!(window(&[family(all, 1), family(all, 1)]), shown);
    }
}
