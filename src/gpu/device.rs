//! The open device: its queues, its allocator, and the names of its objects.

use std::any::{Any, TypeId};
use std::collections::{BTreeSet, HashMap};
use std::ffi::{CStr, CString};
use std::fmt;
use std::mem::ManuallyDrop;
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use ash::{ext, khr, vk};
use gpu_allocator::vulkan::{Allocator, AllocatorCreateDesc};
use gpu_allocator::{AllocationSizes, AllocatorDebugSettings};

use super::error::{GpuError, Result};
use super::instance::Instance;
use super::kinds::{MemoryKind, QueueKind};
use super::lock::lock;
use super::physical::{self, DeviceInfo, Features, Limits, QueuePlan};
use super::pipeline_cache::PipelineCache;
#[cfg(feature = "view")]
use super::surface::{self, RawSurface, Window};

/// Blocks that small buffers share, in the device's memory and in the host's.
const DEVICE_BLOCK_BYTES: u64 = 16 << 20;
const HOST_BLOCK_BYTES: u64 = 8 << 20;

/// How to open a device.
#[derive(Clone, Debug, Default)]
pub struct GpuOptions {
    /// Index in [`super::list_devices`]; without it the best one is taken.
    pub device: Option<usize>,
    /// Turns the validation layer on, with synchronization validation; see [`Gpu::messages`].
    pub validate: bool,
    /// Further layers by name, enabled after (that is: below) validation.
    pub layers: Vec<String>,
    /// Lets the driver's compiler say what it made of shaders, where it can: see
    /// [`super::ComputePipeline::statistics`].
    pub statistics: bool,
    /// Folder of the pipeline caches, which last from run to run; `None`: there is none.
    pub cache: Option<PathBuf>,
}

/// A queue and its family.
pub(super) struct Queue {
    pub handle: vk::Queue,
    pub family: u32,
}

/// An open device. A clone is another handle to the same device.
#[derive(Clone)]
pub struct Gpu(pub(super) Arc<Inner>);

/// Everything that lives as long as the device; see [`Inner::drop`] for the order in which it goes.
pub(super) struct Inner {
    pub device: ash::Device,
    pub allocator: Mutex<ManuallyDrop<Allocator>>,
    pub allocated_bytes: AtomicU64,
    pub pipeline_cache: PipelineCache,
    /// See [`Gpu::shared`].
    shared: Mutex<HashMap<TypeId, Arc<dyn Any + Send + Sync>>>,
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
    pub instance: Instance,
}

impl Gpu {
    /// Opens the device that `options` name, or else the best: discrete, integrated, virtual, CPU.
    pub fn new(options: &GpuOptions) -> Result<Gpu> {
        let instance = Instance::new(options.validate, &options.layers, &[])?;
        let (physical, info) = physical::choose(&physical::devices(&instance)?, options.device)?;
        Gpu::open(instance, physical, info, options, |_| None)
    }

    /// Opens a device that can show images in `window`, chosen as by [`Gpu::new`] among those that can.
    #[cfg(feature = "view")]
    pub fn for_window(options: &GpuOptions, window: &dyn Window) -> Result<Gpu> {
        let extensions = surface::instance_extensions(window)?;
        let instance = Instance::new(options.validate, &options.layers, &extensions)?;
        let surface = RawSurface::new(&instance.entry, &instance.handle, window)?;
        let mut devices = physical::devices(&instance)?;
        for (physical, info) in &mut devices {
            info.missing.extend(surface.missing(&instance.handle, *physical));
        }
        let (physical, info) = physical::choose(&devices, options.device)?;
        let presents = surface.families(&instance.handle, physical);
        // Before the instance, which goes with the device if that cannot be opened.
        drop(surface);
        Gpu::open(instance, physical, info, options, |family| Some(presents[family as usize]))
    }

    /// `presents`: whether a family can show images; `None` where that does not matter.
    fn open(
        instance: Instance,
        physical: vk::PhysicalDevice,
        mut info: DeviceInfo,
        options: &GpuOptions,
        presents: impl Fn(u32) -> Option<bool>,
    ) -> Result<Gpu> {
        let vk_instance = &instance.handle;
        // SAFETY: `physical` was enumerated from this instance, which is alive.
        let (families, properties) = unsafe {
            (
                vk_instance.get_physical_device_queue_family_properties(physical),
                vk_instance.get_physical_device_properties(physical),
            )
        };
        let Some(plan) = QueuePlan::of(&families, &presents) else {
            info.missing.push("a queue that computes");
            return Err(info.unsuitable());
        };
        let offered = Features::of(vk_instance, physical);
        let for_window = presents(plan.compute).is_some();
        let Logical { device, has_memory_budget, statistics } =
            Logical::new(vk_instance, (physical, &info), &plan, &offered, for_window, options.statistics)?;
        // SAFETY: the queues were asked for above.
        let (compute, transfer) = unsafe {
            (
                Queue { handle: device.get_device_queue(plan.compute, 0), family: plan.compute },
                plan.transfer
                    .map(|(family, index)| Queue { handle: device.get_device_queue(family, index), family }),
            )
        };
        let names = instance.has_debug_utils.then(|| ext::debug_utils::Device::new(vk_instance, &device));
        let allocator = new_allocator(vk_instance, &device, physical).inspect_err(|_| {
            // SAFETY: nothing was made from the device yet, and it is not used afterwards.
            unsafe { device.destroy_device(None) };
        })?;
        let limits = {
            let transfer = plan.transfer.map_or(plan.compute, |(family, _)| family);
            physical::limits(vk_instance, physical, [plan.compute, transfer].map(|f| &families[f as usize]))
        };
        tracing::debug!("device {info}; queues {plan:?}");
        let pipeline_cache = PipelineCache::new(&device, &properties, options.cache.as_deref());
        let gpu = Gpu(Arc::new(Inner {
            device,
            allocator: Mutex::new(ManuallyDrop::new(allocator)),
            allocated_bytes: AtomicU64::new(0),
            pipeline_cache,
            shared: Mutex::default(),
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

    /// Whether pipelines can be asked for [`super::ComputePipeline::statistics`].
    pub fn has_statistics(&self) -> bool {
        self.0.statistics.is_some()
    }

    /// Bytes that buffers hold now, host-visible ones included.
    pub fn allocated_bytes(&self) -> u64 {
        self.0.allocated_bytes.load(Ordering::Relaxed)
    }

    /// Bytes of the device's own memory that this process may still take: what the driver says is left, where it has
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

    /// Of `asked` bytes for sections, what the device has beside images: at most 7/8 of what is free.
    pub fn bytes_for_sections(&self, asked: u64) -> u64 {
        asked.min(self.free_bytes() / 8 * 7)
    }

    /// What the validation layer said so far (warnings and errors).
    pub fn messages(&self) -> Vec<String> {
        self.0.instance.messages()
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

    /// The one `T` of this device, made when it is first asked for: what a floor above shares between all
    /// handles of the device. It must hold no [`Gpu`] (the device would stay open), and own
    /// nothing of the device, which goes before it.
    pub(super) fn shared<T: Any + Default + Send + Sync>(&self) -> Arc<T> {
        let mut shared = lock(&self.0.shared);
        let one = shared.entry(TypeId::of::<T>()).or_insert_with(|| Arc::<T>::default());
        Arc::clone(one).downcast().expect("it stands under its own type")
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

/// A device with what was enabled on it.
struct Logical {
    device: ash::Device,
    has_memory_budget: bool,
    statistics: Option<khr::pipeline_executable_properties::Device>,
}

impl Logical {
    /// `statistics`: enabled where they are offered.
    fn new(
        instance: &ash::Instance,
        (physical, info): (vk::PhysicalDevice, &DeviceInfo),
        plan: &QueuePlan,
        offered: &Features,
        for_window: bool,
        statistics: bool,
    ) -> Result<Logical> {
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
        // SAFETY: `physical` was enumerated from this instance, which is alive.
        let extensions = unsafe { instance.enumerate_device_extension_properties(physical) }
            .map_err(|e| GpuError::vulkan("vkEnumerateDeviceExtensionProperties", e))?;
        // A device that has this extension must have it enabled (MoltenVK).
        let portability = c"VK_KHR_portability_subset";
        let has = |name: &CStr| extensions.iter().any(|e| e.extension_name_as_c_str() == Ok(name));
        let has_memory_budget = has(ext::memory_budget::NAME);
        let mut enabled: Vec<_> = [portability, ext::memory_budget::NAME]
            .into_iter()
            .filter(|&name| has(name))
            .map(CStr::as_ptr)
            .collect();
        if for_window {
            enabled.push(khr::swapchain::NAME.as_ptr());
        }
        let name = khr::pipeline_executable_properties::NAME;
        let statistics = statistics && offered.pipeline_executable_info && has(name);
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
        let device = unsafe { instance.create_device(physical, &create, None) }
            .map_err(|e| GpuError::vulkan(format!("vkCreateDevice on {}", info.name), e))?;
        let statistics =
            statistics.then(|| khr::pipeline_executable_properties::Device::new(instance, &device));
        Ok(Logical { device, has_memory_budget, statistics })
    }
}

/// The allocator of all memory of a device.
fn new_allocator(
    instance: &ash::Instance,
    device: &ash::Device,
    physical: vk::PhysicalDevice,
) -> Result<Allocator> {
    Allocator::new(&AllocatorCreateDesc {
        instance: instance.clone(),
        device: device.clone(),
        physical_device: physical,
        debug_settings: AllocatorDebugSettings::default(),
        buffer_device_address: true,
        // Large buffers get an allocation of their own, see `memory`.
        allocation_sizes: AllocationSizes::new(DEVICE_BLOCK_BYTES, HOST_BLOCK_BYTES),
    })
    .map_err(|e| GpuError::Memory {
        name: "allocator".into(),
        kind: MemoryKind::Device,
        bytes: 0,
        reason: e.to_string(),
    })
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
            self.pipeline_cache.close(&self.device);
            ManuallyDrop::drop(self.allocator.get_mut().unwrap_or_else(PoisonError::into_inner));
            self.device.destroy_device(None);
        }
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

#[cfg(test)]
mod tests {
    use super::*;

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
}
