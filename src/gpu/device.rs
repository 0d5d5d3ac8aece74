//! Instance, choice of device, queues, validation messages.

use std::collections::BTreeSet;
use std::ffi::{CStr, CString, c_void};
use std::fmt;
use std::mem::ManuallyDrop;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use ash::{ext, khr, vk};
use gpu_allocator::vulkan::{Allocator, AllocatorCreateDesc};
use gpu_allocator::{AllocationSizes, AllocatorDebugSettings};

use super::command::RawCommands;
use super::kept::Kept;
use super::pipeline::Programs;
use super::{GpuError, Result};

const VALIDATION_LAYER: &CStr = c"VK_LAYER_KHRONOS_validation";

/// How to open a device.
#[derive(Clone, Debug, Default)]
pub struct GpuOptions {
    /// Index in [`list_devices`]; without it the best one is taken.
    pub device: Option<usize>,
    /// Turns the validation layer on, with synchronization validation; see [`Gpu::messages`].
    pub validate: bool,
    /// Further layers by name, enabled after (that is: below) validation.
    pub layers: Vec<String>,
    /// Lets the driver's compiler say what it made of programs, where it can: see
    /// [`super::ComputePipeline::statistics`].
    pub statistics: bool,
    /// Folder where compiled programs are kept from run to run; `None`: they are not.
    pub cache: Option<PathBuf>,
}

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

/// Device limits that the program asks for.
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

/// The two lines of work. On a device with one queue both are that queue.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum QueueKind {
    /// Builds and frames.
    Compute,
    /// Uploads.
    Transfer,
}

pub(super) struct Queue {
    pub handle: vk::Queue,
    pub family: u32,
}

/// An open device. A clone is another handle to the same device.
#[derive(Clone)]
pub struct Gpu(pub(super) Arc<Inner>);

pub(super) struct Inner {
    pub device: ash::Device,
    pub allocator: Mutex<ManuallyDrop<Allocator>>,
    pub allocated_bytes: AtomicU64,
    pub idle_commands: Mutex<[Vec<RawCommands>; 2]>,
    pub programs: Mutex<Programs>,
    /// What compiling left behind; the driver lets any thread use it.
    pub pipeline_cache: vk::PipelineCache,
    /// Where that is kept, and what of it was there at the start.
    kept: Option<Kept>,
    /// A program was made that may not be in what is kept.
    pub has_compiled: AtomicBool,
    pub compute: Queue,
    /// `None`: the compute queue itself.
    pub transfer: Option<Queue>,
    pub physical: vk::PhysicalDevice,
    /// The driver says how much memory is left.
    has_memory_budget: bool,
    /// Held around every queue call: Vulkan wants queues used by one thread at a time.
    pub submitting: Mutex<()>,
    pub has_host_query_reset: bool,
    /// Asked for, and there.
    pub statistics: Option<khr::pipeline_executable_properties::Device>,
    names: Option<ext::debug_utils::Device>,
    info: DeviceInfo,
    limits: Limits,
    // Last: the device goes before the instance does.
    pub(super) instance: Instance,
}

/// Lists what the loader finds, usable or not.
pub fn list_devices() -> Result<Vec<DeviceInfo>> {
    let instance = Instance::new(&GpuOptions::default(), &[])?;
    Ok(instance.devices()?.into_iter().map(|(_, info)| info).collect())
}

fn listing<'a>(devices: impl Iterator<Item = &'a DeviceInfo>) -> String {
    devices.map(|d| format!("  {d}")).collect::<Vec<_>>().join("\n")
}

impl Gpu {
    /// Opens the device that `options` name, or else the best: discrete, integrated, virtual, CPU.
    pub fn new(options: &GpuOptions) -> Result<Gpu> {
        let instance = Instance::new(options, &[])?;
        let devices = instance.devices()?;
        Gpu::choose(instance, devices, options, |_, _| None)
    }

    /// Opens a device that can show pictures in `window`, chosen as by [`Gpu::new`] among those that can.
    #[cfg(feature = "view")]
    pub fn for_window(options: &GpuOptions, window: &dyn super::Window) -> Result<Gpu> {
        let instance = Instance::new(options, &super::swapchain::instance_extensions(window)?)?;
        let surface = super::swapchain::RawSurface::new(&instance.entry, &instance.handle, window)?;
        let mut devices = instance.devices()?;
        for (physical, info) in &mut devices {
            info.missing.extend(surface.missing(&instance.handle, *physical));
        }
        let mut shows = std::collections::HashMap::new();
        for (physical, _) in &devices {
            shows.insert(*physical, surface.families(&instance.handle, *physical));
        }
        // Before the instance, which goes with the choice if that fails.
        drop(surface);
        let presents = |physical, family: u32| Some(shows[&physical][family as usize]);
        Gpu::choose(instance, devices, options, presents)
    }

    /// `presents`: whether a family of a device can show pictures; `None` where that does not matter.
    fn choose(
        instance: Instance,
        devices: Vec<(vk::PhysicalDevice, DeviceInfo)>,
        options: &GpuOptions,
        presents: impl Fn(vk::PhysicalDevice, u32) -> Option<bool>,
    ) -> Result<Gpu> {
        if devices.is_empty() {
            return Err(GpuError::NoDevice);
        }
        let chosen = match options.device {
            Some(index) => devices.get(index).ok_or_else(|| GpuError::NoSuchDevice {
                index,
                listing: listing(devices.iter().map(|(_, d)| d)),
            })?,
            None => devices
                .iter()
                .filter(|(_, d)| d.missing.is_empty())
                .min_by_key(|(_, d)| (d.kind, d.index))
                .ok_or_else(|| GpuError::NoUsableDevice {
                    listing: listing(devices.iter().map(|(_, d)| d)),
                })?,
        };
        let (physical, info) = chosen.clone();
        if !info.missing.is_empty() {
            let DeviceInfo { index, name, missing, .. } = info;
            return Err(GpuError::Unsuitable { index, name, missing: missing.join(", ") });
        }
        Gpu::open(instance, physical, info, options, |family| presents(physical, family))
    }

    fn open(
        instance: Instance,
        physical: vk::PhysicalDevice,
        mut info: DeviceInfo,
        options: &GpuOptions,
        presents: impl Fn(u32) -> Option<bool>,
    ) -> Result<Gpu> {
        let vk_instance = &instance.handle;
        // SAFETY: `physical` was enumerated from this instance, which outlives the calls.
        let (families, extensions) = unsafe {
            (
                vk_instance.get_physical_device_queue_family_properties(physical),
                vk_instance
                    .enumerate_device_extension_properties(physical)
                    .map_err(|e| GpuError::vulkan("vkEnumerateDeviceExtensionProperties", e))?,
            )
        };
        let Some(plan) = QueuePlan::of(&families, &presents) else {
            info.missing.push("a queue that computes");
            let DeviceInfo { index, name, missing, .. } = info;
            return Err(GpuError::Unsuitable { index, name, missing: missing.join(", ") });
        };

        let priorities = [1.0, 1.0];
        let queue = |family, count: usize| {
            vk::DeviceQueueCreateInfo::default()
                .queue_family_index(family)
                .queue_priorities(&priorities[..count])
        };
        let queues = match plan.transfer {
            Some((family, _)) if family != plan.compute => vec![queue(plan.compute, 1), queue(family, 1)],
            Some(_) => vec![queue(plan.compute, 2)],
            None => vec![queue(plan.compute, 1)],
        };
        // A device that has this extension must have it enabled (MoltenVK).
        let portability = c"VK_KHR_portability_subset";
        let has = |name: &CStr| extensions.iter().any(|e| e.extension_name_as_c_str() == Ok(name));
        let has_memory_budget = has(ext::memory_budget::NAME);
        let mut enabled: Vec<_> = [portability, ext::memory_budget::NAME]
            .into_iter()
            .filter(|&name| has(name))
            .map(CStr::as_ptr)
            .collect();
        let for_window = presents(plan.compute).is_some();
        if for_window {
            enabled.push(khr::swapchain::NAME.as_ptr());
        }
        let offered = Features::of(vk_instance, physical);
        let name = khr::pipeline_executable_properties::NAME;
        let statistics = options.statistics
            && offered.pipeline_executable_info
            && extensions.iter().any(|e| e.extension_name_as_c_str() == Ok(name));
        let mut with_statistics = vk::PhysicalDevicePipelineExecutablePropertiesFeaturesKHR::default()
            .pipeline_executable_info(true);
        if statistics {
            enabled.push(name.as_ptr());
        }
        let mut features12 = vk::PhysicalDeviceVulkan12Features::default()
            .timeline_semaphore(true)
            .buffer_device_address(true)
            .scalar_block_layout(true)
            .host_query_reset(offered.host_query_reset);
        let mut features13 = vk::PhysicalDeviceVulkan13Features::default()
            .synchronization2(true)
            .maintenance4(true)
            .dynamic_rendering(for_window);
        let mut create = vk::DeviceCreateInfo::default()
            .queue_create_infos(&queues)
            .enabled_extension_names(&enabled)
            .push_next(&mut features12)
            .push_next(&mut features13);
        if statistics {
            create = create.push_next(&mut with_statistics);
        }
        // SAFETY: every pointer in `create` is alive in this scope; the instance outlives the device
        // because `Inner` destroys the device first.
        let device = unsafe { vk_instance.create_device(physical, &create, None) }
            .map_err(|e| GpuError::vulkan(format!("vkCreateDevice on {}", info.name), e))?;
        // SAFETY: the queues were asked for above.
        let (compute, transfer) = unsafe {
            (
                Queue { handle: device.get_device_queue(plan.compute, 0), family: plan.compute },
                plan.transfer
                    .map(|(family, index)| Queue { handle: device.get_device_queue(family, index), family }),
            )
        };
        let statistics =
            statistics.then(|| khr::pipeline_executable_properties::Device::new(vk_instance, &device));
        let names = instance.has_debug_utils.then(|| ext::debug_utils::Device::new(vk_instance, &device));
        let allocator = Allocator::new(&AllocatorCreateDesc {
            instance: vk_instance.clone(),
            device: device.clone(),
            physical_device: physical,
            debug_settings: AllocatorDebugSettings::default(),
            buffer_device_address: true,
            // Small blocks: large buffers get an allocation of their own, see `memory`.
            allocation_sizes: AllocationSizes::new(16 << 20, 8 << 20),
        });
        let allocator = match allocator {
            Ok(allocator) => allocator,
            Err(e) => {
                // SAFETY: nothing was made from the device yet.
                unsafe { device.destroy_device(None) };
                return Err(GpuError::Memory {
                    name: "allocator".into(),
                    kind: super::MemoryKind::Device,
                    bytes: 0,
                    reason: e.to_string(),
                });
            }
        };
        let limits = {
            let transfer = plan.transfer.map_or(plan.compute, |(family, _)| family);
            limits(vk_instance, physical, [plan.compute, transfer].map(|f| &families[f as usize]))
        };
        tracing::debug!("device {info}; queues {plan:?}");
        // SAFETY: `physical` was enumerated from this instance.
        let properties = unsafe { vk_instance.get_physical_device_properties(physical) };
        let mut kept = options.cache.as_deref().map(|folder| Kept::of(folder, &properties));
        let data = kept.as_mut().and_then(Kept::load).unwrap_or_default();
        let make = |data: &[u8]| {
            let create = vk::PipelineCacheCreateInfo::default().initial_data(data);
            // SAFETY: the device is alive; the data is what its driver wrote: whose it is, and its checksum, were
            // looked at.
            unsafe { device.create_pipeline_cache(&create, None) }
        };
        // Without a cache programs are made as well.
        let pipeline_cache = make(&data).or_else(|_| make(&[])).unwrap_or(vk::PipelineCache::null());
        let gpu = Gpu(Arc::new(Inner {
            device,
            allocator: Mutex::new(ManuallyDrop::new(allocator)),
            allocated_bytes: AtomicU64::new(0),
            idle_commands: Mutex::default(),
            programs: Mutex::default(),
            pipeline_cache,
            kept,
            has_compiled: AtomicBool::new(false),
            compute,
            transfer,
            physical,
            has_memory_budget,
            submitting: Mutex::new(()),
            has_host_query_reset: offered.host_query_reset,
            statistics,
            names,
            info,
            limits,
            instance,
        }));
        gpu.name_object(gpu.0.compute.handle, "compute queue");
        if let Some(transfer) = &gpu.0.transfer {
            gpu.name_object(transfer.handle, "transfer queue");
        }
        Ok(gpu)
    }

    /// What the driver says of the device.
    pub fn info(&self) -> &DeviceInfo {
        &self.0.info
    }

    /// What the device can do at most.
    pub fn limits(&self) -> &Limits {
        &self.0.limits
    }

    /// Whether copies have a queue of their own.
    pub fn has_transfer_queue(&self) -> bool {
        self.0.transfer.is_some()
    }

    /// Whether programs can be asked for [`super::ComputePipeline::statistics`].
    pub fn has_statistics(&self) -> bool {
        self.0.statistics.is_some()
    }

    /// Bytes that buffers hold now, host-visible ones included.
    pub fn allocated_bytes(&self) -> u64 {
        self.0.allocated_bytes.load(Ordering::Relaxed)
    }

    /// Bytes of the device's own memory that the program may still take: what the driver says is left, where it has
    /// VK_EXT_memory_budget, else all there is.
    pub fn free_bytes(&self) -> u64 {
        let mut budget = vk::PhysicalDeviceMemoryBudgetPropertiesEXT::default();
        let mut memory = vk::PhysicalDeviceMemoryProperties2::default();
        if self.0.has_memory_budget {
            memory = memory.push_next(&mut budget);
        }
        // SAFETY: the instance is alive, and the device knows the struct where it has the extension.
        unsafe {
            self.0.instance.handle.get_physical_device_memory_properties2(self.0.physical, &mut memory);
        }
        let heaps = memory.memory_properties;
        free_bytes(heaps.memory_heaps_as_slice(), &budget.heap_budget, &budget.heap_usage)
    }

    /// Of `asked` bytes for sections, what the device has beside pictures: at most 7/8 of what is free.
    pub fn bytes_for_sections(&self, asked: u64) -> u64 {
        asked.min(self.free_bytes() / 8 * 7)
    }

    /// What the validation layer said so far (warnings and errors).
    pub fn messages(&self) -> Vec<String> {
        lock(&self.0.instance.messages.list).clone()
    }

    /// Waits until every submitted command is done. For the end of things, not for frames.
    pub(super) fn wait_idle(&self) {
        let _guard = lock(&self.0.submitting);
        // SAFETY: the device is alive, and no other thread uses a queue while the lock is held.
        if let Err(e) = unsafe { self.0.device.device_wait_idle() } {
            tracing::error!("vkDeviceWaitIdle: {e}");
        }
    }

    pub(super) fn queue(&self, kind: QueueKind) -> &Queue {
        match (kind, &self.0.transfer) {
            (QueueKind::Transfer, Some(queue)) => queue,
            _ => &self.0.compute,
        }
    }

    /// Families that share a buffer, without repetition.
    pub(super) fn families(&self) -> Vec<u32> {
        let families = [QueueKind::Compute, QueueKind::Transfer].map(|kind| self.queue(kind).family);
        families.into_iter().collect::<BTreeSet<_>>().into_iter().collect()
    }

    pub(super) fn device(&self) -> &ash::Device {
        &self.0.device
    }

    pub(super) fn name_object<H: vk::Handle>(&self, handle: H, name: &str) {
        let Some(debug) = &self.0.names else { return };
        let name = CString::new(name.replace('\0', " ")).unwrap_or_default();
        let info = vk::DebugUtilsObjectNameInfoEXT::default().object_handle(handle).object_name(&name);
        // SAFETY: the handle belongs to this device and is alive: its maker names it.
        if let Err(e) = unsafe { debug.set_debug_utils_object_name(&info) } {
            tracing::debug!("naming {name:?}: {e}");
        }
    }
}

impl fmt::Debug for Gpu {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Gpu({})", self.0.info)
    }
}

impl Drop for Inner {
    fn drop(&mut self) {
        // SAFETY: every object made from the device holds a `Gpu`, so none is left; timelines wait
        // before they drop, so the device is idle, and this one wait covers a timeline that failed.
        unsafe {
            let _ = self.device.device_wait_idle();
            for raw in
                self.idle_commands.get_mut().unwrap_or_else(PoisonError::into_inner).iter_mut().flatten()
            {
                raw.destroy(&self.device);
            }
            if let Some(kept) = self.kept.as_ref().filter(|_| *self.has_compiled.get_mut())
                && let Ok(data) = self.device.get_pipeline_cache_data(self.pipeline_cache)
                && let Err(e) = kept.save(&data)
            {
                tracing::debug!("compiled programs are not kept: {e}");
            }
            self.device.destroy_pipeline_cache(self.pipeline_cache, None);
            ManuallyDrop::drop(self.allocator.get_mut().unwrap_or_else(PoisonError::into_inner));
            self.device.destroy_device(None);
        }
    }
}

/// A lock that a panic elsewhere does not take away: what these locks guard is never half done.
pub(super) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Which families and queues serve compute and transfer.
#[derive(Debug, PartialEq)]
struct QueuePlan {
    compute: u32,
    /// Family and index in it.
    transfer: Option<(u32, u32)>,
}

impl QueuePlan {
    /// `presents`: whether a family computes, draws and shows pictures; `None` where that does not matter.
    fn of(
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

/// What is left of the device's own heaps: of their budgets, where those are told (not 0), else of their sizes.
fn free_bytes(heaps: &[vk::MemoryHeap], budgets: &[u64], used: &[u64]) -> u64 {
    heaps
        .iter()
        .zip(budgets.iter().zip(used))
        .filter(|(heap, _)| heap.flags.contains(vk::MemoryHeapFlags::DEVICE_LOCAL))
        .map(|(heap, (&budget, &used))| match budget {
            0 => heap.size,
            budget => budget.min(heap.size).saturating_sub(used),
        })
        .sum()
}

struct Features {
    host_query_reset: bool,
    pipeline_executable_info: bool,
    missing: Vec<&'static str>,
}

impl Features {
    fn of(instance: &ash::Instance, physical: vk::PhysicalDevice) -> Features {
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

fn limits(
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

/// Validation messages, as the layer's callback leaves them.
#[derive(Default)]
struct Messages {
    list: Mutex<Vec<String>>,
}

pub(super) struct Instance {
    pub handle: ash::Instance,
    messenger: Option<(ext::debug_utils::Instance, vk::DebugUtilsMessengerEXT)>,
    has_debug_utils: bool,
    // The driver calls back with a pointer to it until the instance is gone.
    messages: Box<Messages>,
    /// Keeps the loader library open.
    pub entry: ash::Entry,
}

impl Instance {
    /// `wanted`: further extensions.
    fn new(options: &GpuOptions, wanted: &[&'static CStr]) -> Result<Instance> {
        // SAFETY: loading the Vulkan loader runs its initialisers; it is kept open as long as the
        // instance lives.
        let entry =
            unsafe { ash::Entry::load() }.map_err(|e| GpuError::NoLoader { reason: e.to_string() })?;
        let offered = |layer: Option<&CStr>| -> Vec<CString> {
            // SAFETY: the loader is open.
            let list = unsafe { entry.enumerate_instance_extension_properties(layer) };
            list.unwrap_or_default()
                .iter()
                .filter_map(|e| e.extension_name_as_c_str().ok().map(CStr::to_owned))
                .collect()
        };
        let extensions = offered(None);
        let has = |name: &CStr| extensions.iter().any(|e| e.as_c_str() == name);

        let mut layers: Vec<CString> = Vec::new();
        if options.validate {
            layers.push(VALIDATION_LAYER.to_owned());
        }
        layers.extend(options.layers.iter().map(|l| CString::new(l.as_str()).unwrap_or_default()));
        // SAFETY: the loader is open.
        let installed = unsafe { entry.enumerate_instance_layer_properties() }
            .map_err(|e| GpuError::vulkan("vkEnumerateInstanceLayerProperties", e))?;
        if let Some(layer) =
            layers.iter().find(|l| !installed.iter().any(|i| i.layer_name_as_c_str() == Ok(l.as_c_str())))
        {
            let hint = if layer.as_c_str() == VALIDATION_LAYER {
                " (Debian, Ubuntu: `apt install vulkan-validationlayers`; elsewhere it comes with the Vulkan SDK)"
            } else {
                ""
            };
            return Err(GpuError::NoLayer { name: layer.to_string_lossy().into_owned(), hint });
        }

        if let Some(name) = wanted.iter().find(|name| !has(name)) {
            return Err(GpuError::NoWindow {
                reason: format!("the Vulkan loader lacks {}", name.to_string_lossy()),
            });
        }
        let mut enabled: Vec<&CStr> = wanted.to_vec();
        let mut flags = vk::InstanceCreateFlags::empty();
        if has(khr::portability_enumeration::NAME) {
            enabled.push(khr::portability_enumeration::NAME);
            flags |= vk::InstanceCreateFlags::ENUMERATE_PORTABILITY_KHR;
        }
        let has_debug_utils = has(ext::debug_utils::NAME);
        if has_debug_utils {
            enabled.push(ext::debug_utils::NAME);
        }
        let validation_extensions =
            if options.validate { offered(Some(VALIDATION_LAYER)) } else { Vec::new() };
        // The layer's newer way to say this, VK_EXT_layer_settings, is unknown to loaders before 1.3.272.
        let with_features =
            validation_extensions.iter().any(|e| e.as_c_str() == ext::validation_features::NAME);
        if with_features {
            enabled.push(ext::validation_features::NAME);
        }

        let layer_names: Vec<_> = layers.iter().map(|l| l.as_ptr()).collect();
        let extension_names: Vec<_> = enabled.iter().map(|e| e.as_ptr()).collect();
        let application =
            vk::ApplicationInfo::default().application_name(c"lasray").api_version(vk::API_VERSION_1_3);
        let checks = [vk::ValidationFeatureEnableEXT::SYNCHRONIZATION_VALIDATION];
        let mut features = vk::ValidationFeaturesEXT::default().enabled_validation_features(&checks);
        let messages = Box::<Messages>::default();
        let mut messenger_info = vk::DebugUtilsMessengerCreateInfoEXT::default()
            .message_severity(
                vk::DebugUtilsMessageSeverityFlagsEXT::ERROR | vk::DebugUtilsMessageSeverityFlagsEXT::WARNING,
            )
            .message_type(
                vk::DebugUtilsMessageTypeFlagsEXT::VALIDATION
                    | vk::DebugUtilsMessageTypeFlagsEXT::PERFORMANCE,
            )
            .pfn_user_callback(Some(on_message))
            .user_data((&raw const *messages).cast_mut().cast());
        let mut create = vk::InstanceCreateInfo::default()
            .flags(flags)
            .application_info(&application)
            .enabled_layer_names(&layer_names)
            .enabled_extension_names(&extension_names);
        if with_features {
            create = create.push_next(&mut features);
        }
        if options.validate && has_debug_utils {
            create = create.push_next(&mut messenger_info);
        }
        // SAFETY: every pointer in `create` is alive in this scope.
        let handle = match unsafe { entry.create_instance(&create, None) } {
            Ok(handle) => handle,
            Err(vk::Result::ERROR_INCOMPATIBLE_DRIVER) => return Err(GpuError::NoDevice),
            Err(e) => return Err(GpuError::vulkan("vkCreateInstance", e)),
        };
        let mut instance = Instance { handle, messenger: None, has_debug_utils, messages, entry };
        if options.validate && has_debug_utils {
            let debug = ext::debug_utils::Instance::new(&instance.entry, &instance.handle);
            messenger_info.p_next = std::ptr::null();
            // SAFETY: the extension is enabled; `messages` is boxed and lives until after the instance.
            let messenger = unsafe { debug.create_debug_utils_messenger(&messenger_info, None) }
                .map_err(|e| GpuError::vulkan("vkCreateDebugUtilsMessengerEXT", e))?;
            instance.messenger = Some((debug, messenger));
        }
        Ok(instance)
    }

    fn devices(&self) -> Result<Vec<(vk::PhysicalDevice, DeviceInfo)>> {
        // SAFETY: the instance is alive.
        let list = match unsafe { self.handle.enumerate_physical_devices() } {
            Ok(list) => list,
            Err(vk::Result::ERROR_INITIALIZATION_FAILED) => return Err(GpuError::NoDevice),
            Err(e) => return Err(GpuError::vulkan("vkEnumeratePhysicalDevices", e)),
        };
        Ok(list
            .into_iter()
            .enumerate()
            .map(|(i, physical)| (physical, device_info(&self.handle, physical, i)))
            .collect())
    }
}

impl Drop for Instance {
    fn drop(&mut self) {
        // SAFETY: the device is gone (field order of `Inner`), so nothing of this instance is in use.
        unsafe {
            if let Some((debug, messenger)) = &self.messenger {
                debug.destroy_debug_utils_messenger(*messenger, None);
            }
            self.handle.destroy_instance(None);
        }
    }
}

/// Whether a message of that name is a fault of this program: the loader speaks through the same callback, of drivers and
/// layers that are newer than it is; so does the layer of functions that the loader looks for at the wrong level, as
/// Debian 12's does with NVIDIA's driver of 2026 (this program looks up what it calls by `ash` alone).
fn is_of_validation(id: &str) -> bool {
    !["Loader Message", "WARNING-vkGetDeviceProcAddr-device"].contains(&id)
}

unsafe extern "system" fn on_message(
    _severity: vk::DebugUtilsMessageSeverityFlagsEXT,
    _kind: vk::DebugUtilsMessageTypeFlagsEXT,
    data: *const vk::DebugUtilsMessengerCallbackDataEXT<'_>,
    user: *mut c_void,
) -> vk::Bool32 {
    // SAFETY: the layer passes its own data, and the `Messages` that the messenger was made with,
    // which outlives the instance.
    let (messages, id, message) = unsafe {
        let text = |s: Option<&CStr>| s.unwrap_or_default().to_string_lossy().into_owned();
        let (id, message) = ((*data).message_id_name_as_c_str(), (*data).message_as_c_str());
        (&*user.cast_const().cast::<Messages>(), text(id), text(message))
    };
    let text = format!("{id}: {message}");
    if !is_of_validation(&id) {
        tracing::debug!("{text}");
        return vk::FALSE;
    }
    tracing::error!("validation: {text}");
    lock(&messages.list).push(text);
    vk::FALSE
}

#[cfg(test)]
mod tests {
    use super::*;

    fn family(flags: vk::QueueFlags, count: u32) -> vk::QueueFamilyProperties {
        vk::QueueFamilyProperties { queue_flags: flags, queue_count: count, ..Default::default() }
    }

    #[test]
    fn what_others_hold_is_not_free() {
        const GIB: u64 = 1 << 30;
        let heap = |size, flags| vk::MemoryHeap { size, flags };
        let (own, host) = (vk::MemoryHeapFlags::DEVICE_LOCAL, vk::MemoryHeapFlags::empty());
        let heaps = [heap(8 * GIB, own), heap(64 * GIB, host), heap(GIB / 4, own)];
        // The driver does not say.
        assert_eq!(free_bytes(&heaps, &[0; 16], &[0; 16]), 8 * GIB + GIB / 4);
        // Others have taken most of it, this process a little.
        assert_eq!(
            free_bytes(&heaps, &[2 * GIB, 60 * GIB, GIB / 8], &[GIB / 2, GIB, 0]),
            GIB * 3 / 2 + GIB / 8
        );
        // More is held than it should be; a budget that is larger than the heap.
        assert_eq!(free_bytes(&heaps, &[GIB, GIB, GIB], &[2 * GIB, 0, 0]), GIB / 4);
        assert_eq!(free_bytes(&heaps[1..2], &[GIB], &[0]), 0);
    }

    #[test]
    fn what_the_loader_says_is_no_fault() {
        assert!(!is_of_validation("Loader Message"));
        assert!(!is_of_validation("WARNING-vkGetDeviceProcAddr-device"));
        for id in
            ["VUID-vkCmdDispatch-None-08114", "SYNC-HAZARD-WRITE-AFTER-READ", "UNASSIGNED-Threading-Info", ""]
        {
            assert!(is_of_validation(id), "{id}");
        }
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
        // For a window, the family that shows pictures.
        let window = |families: &[vk::QueueFamilyProperties]| QueuePlan::of(families, |f| Some(f == 1));
        assert_eq!(window(&[family(all, 1)]), None);
        let shown = Some(QueuePlan { compute: 1, transfer: None });
        assert_eq!(window(&[family(all, 1), family(all, 1)]), shown);
    }
}
