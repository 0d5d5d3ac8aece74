//! A Vulkan layer for tests: shows a one-queue device as family 0 (as it is) and family 1 (transfer
//! only), and hands the submits of both to the one queue in an order of its choosing. See the README.
//
// SAFETY, for all of this crate: the entry points are called by the Vulkan loader, with handles and
// pointers that are valid as the specification demands; what they pass on is the caller's, with queues
// and queue families replaced by the real ones. Copies of the caller's arrays are made before it returns.
#![allow(unsafe_op_in_unsafe_fn, clippy::missing_safety_doc)]

mod schedule;

use std::collections::HashMap;
use std::ffi::{CStr, c_char, c_void};
use std::mem::transmute;
use std::slice::from_raw_parts;
use std::sync::atomic::AtomicUsize;
use std::sync::{Arc, LazyLock, Mutex, MutexGuard, PoisonError};

use ash::{ext, khr, vk};
use schedule::{Driver, Mode, Scheduler, Submit, Want};

/// The name to enable it by.
pub const LAYER_NAME: &str = "VK_LAYER_TEST_two_queues";

// ---- what the loader passes (vk_layer.h) ----

const LOADER_INSTANCE_CREATE_INFO: vk::StructureType = vk::StructureType::from_raw(47);
const LOADER_DEVICE_CREATE_INFO: vk::StructureType = vk::StructureType::from_raw(48);
const LINK_INFO: u32 = 0;

/// `VkLayerInstanceCreateInfo` and `VkLayerDeviceCreateInfo`: the same shape.
#[repr(C)]
struct LayerCreateInfo<L> {
    s_type: vk::StructureType,
    next: *mut LayerCreateInfo<L>,
    function: u32,
    link: *mut L,
}

#[repr(C)]
struct InstanceLink {
    next: *mut InstanceLink,
    get_instance_proc_addr: vk::PFN_vkGetInstanceProcAddr,
    get_physical_device_proc_addr: *const c_void,
}

#[repr(C)]
struct DeviceLink {
    next: *mut DeviceLink,
    get_instance_proc_addr: vk::PFN_vkGetInstanceProcAddr,
    get_device_proc_addr: vk::PFN_vkGetDeviceProcAddr,
}

/// `VkNegotiateLayerInterface`.
#[repr(C)]
pub struct NegotiateInterface {
    s_type: u32,
    next: *mut c_void,
    version: u32,
    get_instance_proc_addr: vk::PFN_vkGetInstanceProcAddr,
    get_device_proc_addr: vk::PFN_vkGetDeviceProcAddr,
    get_physical_device_proc_addr: *const c_void,
}

/// The link of this layer in a create call; the next layer's is left in its place.
unsafe fn take_link<L>(chain: *const c_void, kind: vk::StructureType) -> Option<*mut L> {
    let mut info = chain.cast_mut().cast::<LayerCreateInfo<L>>();
    while !info.is_null() {
        if (*info).s_type == kind && (*info).function == LINK_INFO {
            return Some((*info).link);
        }
        info = (*info).next;
    }
    None
}

unsafe fn leave_link<L>(chain: *const c_void, kind: vk::StructureType, next: *mut L) {
    let mut info = chain.cast_mut().cast::<LayerCreateInfo<L>>();
    while !info.is_null() {
        if (*info).s_type == kind && (*info).function == LINK_INFO {
            (*info).link = next;
            return;
        }
        info = (*info).next;
    }
}

// ---- state ----

/// The loader's dispatch table: the first word of every dispatchable handle, the same for all handles
/// of an instance (and its physical devices), or of a device (and its queues and command buffers).
type Key = usize;

unsafe fn key_of<H: vk::Handle>(handle: H) -> Key {
    *(handle.as_raw() as *const Key)
}

struct Instance {
    get_proc: vk::PFN_vkGetInstanceProcAddr,
    fns: ash::Instance,
    surface: khr::surface::InstanceFn,
}

/// What a program holds as a `VkQueue`.
#[repr(C)]
struct Queue {
    /// Belongs to the loader, which writes its own table here.
    dispatch: AtomicUsize,
    family: usize,
}

struct Device {
    get_proc: vk::PFN_vkGetDeviceProcAddr,
    fns: ash::Device,
    debug: ext::debug_utils::DeviceFn,
    swapchain: khr::swapchain::DeviceFn,
    real: vk::Queue,
    /// Boxed: their addresses are handles.
    queues: Box<[Queue; 2]>,
    scheduler: Mutex<Scheduler<Real>>,
}

/// The driver's one queue.
struct Real {
    fns: ash::Device,
    queue: vk::Queue,
}

impl Driver for Real {
    fn submit(&self, submit: &Submit) -> vk::Result {
        let info = vk::SubmitInfo2::default()
            .wait_semaphore_infos(&submit.waits)
            .command_buffer_infos(&submit.commands)
            .signal_semaphore_infos(&submit.signals);
        // A fence alone signals when all before it is done: no batch then.
        let empty = submit.waits.is_empty() && submit.commands.is_empty() && submit.signals.is_empty();
        let count = u32::from(!empty);
        // SAFETY: the program keeps what it submitted alive until it has seen it done.
        unsafe { (self.fns.fp_v1_3().queue_submit2)(self.queue, count, &info, submit.fence) }
    }

    fn counter(&self, semaphore: vk::Semaphore) -> u64 {
        // SAFETY: the program keeps the semaphore alive while submits wait for it.
        unsafe { self.fns.get_semaphore_counter_value(semaphore) }.unwrap_or(0)
    }
}

static INSTANCES: LazyLock<Mutex<HashMap<Key, Arc<Instance>>>> = LazyLock::new(Mutex::default);
static DEVICES: LazyLock<Mutex<HashMap<Key, Arc<Device>>>> = LazyLock::new(Mutex::default);

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

unsafe fn instance_of<H: vk::Handle>(handle: H) -> Arc<Instance> {
    lock(&INSTANCES).get(&key_of(handle)).expect("an instance made through this layer").clone()
}

unsafe fn device_of<H: vk::Handle>(handle: H) -> Arc<Device> {
    lock(&DEVICES).get(&key_of(handle)).expect("a device made through this layer").clone()
}

impl Device {
    fn schedule(&self) -> MutexGuard<'_, Scheduler<Real>> {
        lock(&self.scheduler)
    }
}

unsafe fn family_of(queue: vk::Queue) -> usize {
    (*(vk::Handle::as_raw(queue) as *const Queue)).family
}

/// Null pointers come with a count of 0.
unsafe fn slice<'a, T>(data: *const T, len: u32) -> &'a [T] {
    if len == 0 { &[] } else { from_raw_parts(data, len as usize) }
}

// ---- submits and waits ----

unsafe extern "system" fn queue_submit2(
    queue: vk::Queue,
    count: u32,
    submits: *const vk::SubmitInfo2<'_>,
    fence: vk::Fence,
) -> vk::Result {
    let semaphores = |data, len| {
        let copy = |s: &vk::SemaphoreSubmitInfo<'_>| {
            let info = vk::SemaphoreSubmitInfo::default().semaphore(s.semaphore);
            info.value(s.value).stage_mask(s.stage_mask).device_index(s.device_index)
        };
        slice(data, len).iter().map(copy).collect()
    };
    let mut batches: Vec<Submit> = slice(submits, count)
        .iter()
        .map(|s| Submit {
            waits: semaphores(s.p_wait_semaphore_infos, s.wait_semaphore_info_count),
            commands: slice(s.p_command_buffer_infos, s.command_buffer_info_count)
                .iter()
                .map(|c| vk::CommandBufferSubmitInfo::default().command_buffer(c.command_buffer))
                .collect(),
            signals: semaphores(s.p_signal_semaphore_infos, s.signal_semaphore_info_count),
            fence: vk::Fence::null(),
        })
        .collect();
    if fence != vk::Fence::null() {
        batches.push(Submit { waits: vec![], commands: vec![], signals: vec![], fence });
    }
    device_of(queue).schedule().submit(family_of(queue), batches)
}

unsafe extern "system" fn queue_submit(
    queue: vk::Queue,
    count: u32,
    submits: *const vk::SubmitInfo<'_>,
    fence: vk::Fence,
) -> vk::Result {
    let mut batches = Vec::new();
    for s in slice(submits, count) {
        let mut values = None;
        let mut next = s.p_next.cast::<vk::BaseInStructure<'_>>();
        while !next.is_null() {
            if (*next).s_type == vk::StructureType::TIMELINE_SEMAPHORE_SUBMIT_INFO {
                values = Some(&*next.cast::<vk::TimelineSemaphoreSubmitInfo<'_>>());
            }
            next = (*next).p_next;
        }
        let (wait_values, signal_values) = values.map_or((&[][..], &[][..]), |v| {
            (
                slice(v.p_wait_semaphore_values, v.wait_semaphore_value_count),
                slice(v.p_signal_semaphore_values, v.signal_semaphore_value_count),
            )
        });
        let info = |semaphore, values: &[u64], i: usize| {
            let value = values.get(i).copied().unwrap_or(0);
            vk::SemaphoreSubmitInfo::default().semaphore(semaphore).value(value)
        };
        let stages = slice(s.p_wait_dst_stage_mask, s.wait_semaphore_count);
        batches.push(Submit {
            waits: slice(s.p_wait_semaphores, s.wait_semaphore_count)
                .iter()
                .zip(stages)
                .enumerate()
                .map(|(i, (&semaphore, stages))| {
                    let stages = vk::PipelineStageFlags2::from_raw(u64::from(stages.as_raw()));
                    info(semaphore, wait_values, i).stage_mask(stages)
                })
                .collect(),
            commands: slice(s.p_command_buffers, s.command_buffer_count)
                .iter()
                .map(|&c| vk::CommandBufferSubmitInfo::default().command_buffer(c))
                .collect(),
            signals: slice(s.p_signal_semaphores, s.signal_semaphore_count)
                .iter()
                .enumerate()
                .map(|(i, &semaphore)| {
                    info(semaphore, signal_values, i).stage_mask(vk::PipelineStageFlags2::ALL_COMMANDS)
                })
                .collect(),
            fence: vk::Fence::null(),
        });
    }
    if fence != vk::Fence::null() {
        batches.push(Submit { waits: vec![], commands: vec![], signals: vec![], fence });
    }
    device_of(queue).schedule().submit(family_of(queue), batches)
}

unsafe extern "system" fn queue_wait_idle(queue: vk::Queue) -> vk::Result {
    let device = device_of(queue);
    let mut scheduler = device.schedule();
    scheduler.flush(family_of(queue));
    (device.fns.fp_v1_0().queue_wait_idle)(device.real)
}

unsafe extern "system" fn device_wait_idle(handle: vk::Device) -> vk::Result {
    let device = device_of(handle);
    let mut scheduler = device.schedule();
    scheduler.flush_all();
    (device.fns.fp_v1_0().device_wait_idle)(handle)
}

unsafe extern "system" fn queue_bind_sparse(
    queue: vk::Queue,
    count: u32,
    binds: *const vk::BindSparseInfo<'_>,
    fence: vk::Fence,
) -> vk::Result {
    let device = device_of(queue);
    let mut scheduler = device.schedule();
    scheduler.flush(family_of(queue));
    (device.fns.fp_v1_0().queue_bind_sparse)(device.real, count, binds, fence)
}

unsafe extern "system" fn queue_present(queue: vk::Queue, info: *const vk::PresentInfoKHR<'_>) -> vk::Result {
    let device = device_of(queue);
    let mut scheduler = device.schedule();
    scheduler.flush(family_of(queue));
    (device.swapchain.queue_present_khr)(device.real, info)
}

unsafe extern "system" fn get_semaphore_counter_value(
    handle: vk::Device,
    semaphore: vk::Semaphore,
    value: *mut u64,
) -> vk::Result {
    let device = device_of(handle);
    let result = (device.fns.fp_v1_2().get_semaphore_counter_value)(handle, semaphore, value);
    device.schedule().polled(semaphore, *value);
    result
}

unsafe extern "system" fn get_fence_status(handle: vk::Device, fence: vk::Fence) -> vk::Result {
    let device = device_of(handle);
    let result = (device.fns.fp_v1_0().get_fence_status)(handle, fence);
    if device.schedule().polled_fence(fence) { vk::Result::NOT_READY } else { result }
}

unsafe extern "system" fn signal_semaphore(
    handle: vk::Device,
    info: *const vk::SemaphoreSignalInfo<'_>,
) -> vk::Result {
    let device = device_of(handle);
    let result = (device.fns.fp_v1_2().signal_semaphore)(handle, info);
    device.schedule().pump();
    result
}

unsafe fn wanting(device: &Device, wants: Vec<Want>, wait: impl FnOnce() -> vk::Result) -> vk::Result {
    let ids: Vec<u64> = {
        let mut scheduler = device.schedule();
        let ids = wants.into_iter().map(|want| scheduler.want(want)).collect();
        scheduler.pump();
        ids
    };
    let result = wait(); // unlocked: another thread may submit what is waited for
    let mut scheduler = device.schedule();
    ids.into_iter().for_each(|id| scheduler.unwant(id));
    result
}

unsafe extern "system" fn wait_semaphores(
    handle: vk::Device,
    info: *const vk::SemaphoreWaitInfo<'_>,
    timeout: u64,
) -> vk::Result {
    let device = device_of(handle);
    let count = (*info).semaphore_count;
    let values = slice((*info).p_values, count);
    let wants = slice((*info).p_semaphores, count).iter().zip(values).map(|(&s, &v)| Want::Semaphore(s, v));
    wanting(&device, wants.collect(), || (device.fns.fp_v1_2().wait_semaphores)(handle, info, timeout))
}

unsafe extern "system" fn wait_for_fences(
    handle: vk::Device,
    count: u32,
    fences: *const vk::Fence,
    all: vk::Bool32,
    timeout: u64,
) -> vk::Result {
    let device = device_of(handle);
    let wants = slice(fences, count).iter().map(|&f| Want::Fence(f)).collect();
    let wait = || (device.fns.fp_v1_0().wait_for_fences)(handle, count, fences, all, timeout);
    wanting(&device, wants, wait)
}

unsafe extern "system" fn create_semaphore(
    handle: vk::Device,
    info: *const vk::SemaphoreCreateInfo<'_>,
    allocator: *const vk::AllocationCallbacks<'_>,
    semaphore: *mut vk::Semaphore,
) -> vk::Result {
    let device = device_of(handle);
    let result = (device.fns.fp_v1_0().create_semaphore)(handle, info, allocator, semaphore);
    let mut next = (*info).p_next.cast::<vk::BaseInStructure<'_>>();
    while result == vk::Result::SUCCESS && !next.is_null() {
        if (*next).s_type == vk::StructureType::SEMAPHORE_TYPE_CREATE_INFO {
            let kind = &*next.cast::<vk::SemaphoreTypeCreateInfo<'_>>();
            if kind.semaphore_type == vk::SemaphoreType::TIMELINE {
                device.schedule().add_timeline(*semaphore, kind.initial_value);
            }
        }
        next = (*next).p_next;
    }
    result
}

unsafe extern "system" fn destroy_semaphore(
    handle: vk::Device,
    semaphore: vk::Semaphore,
    allocator: *const vk::AllocationCallbacks<'_>,
) {
    let device = device_of(handle);
    device.schedule().remove_semaphore(semaphore);
    (device.fns.fp_v1_0().destroy_semaphore)(handle, semaphore, allocator);
}

// ---- family 1 becomes family 0 ----

unsafe extern "system" fn get_device_queue(handle: vk::Device, family: u32, _: u32, queue: *mut vk::Queue) {
    let device = device_of(handle);
    *queue = vk::Handle::from_raw(&raw const device.queues[family as usize] as u64);
}

unsafe extern "system" fn get_device_queue2(
    handle: vk::Device,
    info: *const vk::DeviceQueueInfo2<'_>,
    queue: *mut vk::Queue,
) {
    get_device_queue(handle, (*info).queue_family_index, (*info).queue_index, queue);
}

unsafe extern "system" fn create_command_pool(
    handle: vk::Device,
    info: *const vk::CommandPoolCreateInfo<'_>,
    allocator: *const vk::AllocationCallbacks<'_>,
    pool: *mut vk::CommandPool,
) -> vk::Result {
    let info = (*info).queue_family_index(0);
    (device_of(handle).fns.fp_v1_0().create_command_pool)(handle, &info, allocator, pool)
}

/// Shared by two families above is owned by one below.
fn owned(info: vk::BufferCreateInfo<'_>) -> vk::BufferCreateInfo<'_> {
    info.sharing_mode(vk::SharingMode::EXCLUSIVE).queue_family_indices(&[])
}

unsafe extern "system" fn create_buffer(
    handle: vk::Device,
    info: *const vk::BufferCreateInfo<'_>,
    allocator: *const vk::AllocationCallbacks<'_>,
    buffer: *mut vk::Buffer,
) -> vk::Result {
    (device_of(handle).fns.fp_v1_0().create_buffer)(handle, &owned(*info), allocator, buffer)
}

unsafe extern "system" fn create_image(
    handle: vk::Device,
    info: *const vk::ImageCreateInfo<'_>,
    allocator: *const vk::AllocationCallbacks<'_>,
    image: *mut vk::Image,
) -> vk::Result {
    let info = (*info).sharing_mode(vk::SharingMode::EXCLUSIVE).queue_family_indices(&[]);
    (device_of(handle).fns.fp_v1_0().create_image)(handle, &info, allocator, image)
}

unsafe extern "system" fn get_device_buffer_memory_requirements(
    handle: vk::Device,
    info: *const vk::DeviceBufferMemoryRequirements<'_>,
    requirements: *mut vk::MemoryRequirements2<'_>,
) {
    let create = owned(*(*info).p_create_info);
    let info = vk::DeviceBufferMemoryRequirements::default().create_info(&create);
    (device_of(handle).fns.fp_v1_3().get_device_buffer_memory_requirements)(handle, &info, requirements);
}

// ---- labels and names of queues ----

unsafe extern "system" fn queue_begin_label(queue: vk::Queue, label: *const vk::DebugUtilsLabelEXT<'_>) {
    let device = device_of(queue);
    (device.debug.queue_begin_debug_utils_label_ext)(device.real, label);
}

unsafe extern "system" fn queue_insert_label(queue: vk::Queue, label: *const vk::DebugUtilsLabelEXT<'_>) {
    let device = device_of(queue);
    (device.debug.queue_insert_debug_utils_label_ext)(device.real, label);
}

unsafe extern "system" fn queue_end_label(queue: vk::Queue) {
    let device = device_of(queue);
    (device.debug.queue_end_debug_utils_label_ext)(device.real);
}

unsafe extern "system" fn set_object_name(
    handle: vk::Device,
    info: *const vk::DebugUtilsObjectNameInfoEXT<'_>,
) -> vk::Result {
    let device = device_of(handle);
    let mut info = *info;
    if info.object_type == vk::ObjectType::QUEUE {
        info.object_handle = vk::Handle::as_raw(device.real);
    }
    (device.debug.set_debug_utils_object_name_ext)(handle, &info)
}

unsafe extern "system" fn set_object_tag(
    handle: vk::Device,
    info: *const vk::DebugUtilsObjectTagInfoEXT<'_>,
) -> vk::Result {
    let device = device_of(handle);
    let mut info = *info;
    if info.object_type == vk::ObjectType::QUEUE {
        info.object_handle = vk::Handle::as_raw(device.real);
    }
    (device.debug.set_debug_utils_object_tag_ext)(handle, &info)
}

// ---- instance and device ----

unsafe extern "system" fn get_queue_families(
    physical: vk::PhysicalDevice,
    count: *mut u32,
    out: *mut vk::QueueFamilyProperties,
) {
    if out.is_null() {
        *count = 2;
        return;
    }
    *count = (*count).min(2);
    let (mut one, mut family) = (1, vk::QueueFamilyProperties::default());
    let fns = instance_of(physical);
    (fns.fns.fp_v1_0().get_physical_device_queue_family_properties)(physical, &mut one, &mut family);
    for i in 0..*count {
        *out.add(i as usize) = as_family(i, family);
    }
}

unsafe extern "system" fn get_queue_families2(
    physical: vk::PhysicalDevice,
    count: *mut u32,
    out: *mut vk::QueueFamilyProperties2<'_>,
) {
    if out.is_null() {
        *count = 2;
        return;
    }
    *count = (*count).min(2);
    let fns = instance_of(physical);
    for i in 0..*count {
        // One call each, so that each element's chain is filled.
        let (mut one, element) = (1, out.add(i as usize));
        (fns.fns.fp_v1_1().get_physical_device_queue_family_properties2)(physical, &mut one, element);
        (*element).queue_family_properties = as_family(i, (*element).queue_family_properties);
    }
}

fn as_family(index: u32, mut family: vk::QueueFamilyProperties) -> vk::QueueFamilyProperties {
    family.queue_count = 1;
    if index == 1 {
        family.queue_flags = vk::QueueFlags::TRANSFER;
    }
    family
}

unsafe extern "system" fn get_surface_support(
    physical: vk::PhysicalDevice,
    family: u32,
    surface: vk::SurfaceKHR,
    supported: *mut vk::Bool32,
) -> vk::Result {
    if family == 1 {
        *supported = vk::FALSE;
        return vk::Result::SUCCESS;
    }
    (instance_of(physical).surface.get_physical_device_surface_support_khr)(
        physical, family, surface, supported,
    )
}

unsafe extern "system" fn create_instance(
    info: *const vk::InstanceCreateInfo<'_>,
    allocator: *const vk::AllocationCallbacks<'_>,
    instance: *mut vk::Instance,
) -> vk::Result {
    let chain = (*info).p_next;
    let Some(link) = take_link::<InstanceLink>(chain, LOADER_INSTANCE_CREATE_INFO) else {
        return vk::Result::ERROR_INITIALIZATION_FAILED;
    };
    leave_link(chain, LOADER_INSTANCE_CREATE_INFO, (*link).next);
    let get_proc = (*link).get_instance_proc_addr;
    let create: vk::PFN_vkCreateInstance =
        transmute(get_proc(vk::Instance::null(), c"vkCreateInstance".as_ptr()));
    let result = create(info, allocator, instance);
    if result == vk::Result::SUCCESS {
        // Now, not when needed: once the chain stands, `get_proc` answers from its top, which is above us.
        let load = |name: &CStr| {
            transmute::<vk::PFN_vkVoidFunction, *const c_void>(get_proc(*instance, name.as_ptr()))
        };
        let state = Instance {
            get_proc,
            fns: ash::Instance::load_with(load, *instance),
            surface: khr::surface::InstanceFn::load(load),
        };
        lock(&INSTANCES).insert(key_of(*instance), Arc::new(state));
    }
    result
}

unsafe extern "system" fn destroy_instance(
    instance: vk::Instance,
    allocator: *const vk::AllocationCallbacks<'_>,
) {
    if instance == vk::Instance::null() {
        return;
    }
    let state = lock(&INSTANCES).remove(&key_of(instance));
    if let Some(state) = state {
        (state.fns.fp_v1_0().destroy_instance)(instance, allocator);
    }
}

unsafe extern "system" fn create_device(
    physical: vk::PhysicalDevice,
    info: *const vk::DeviceCreateInfo<'_>,
    allocator: *const vk::AllocationCallbacks<'_>,
    out: *mut vk::Device,
) -> vk::Result {
    let chain = (*info).p_next;
    let Some(link) = take_link::<DeviceLink>(chain, LOADER_DEVICE_CREATE_INFO) else {
        return vk::Result::ERROR_INITIALIZATION_FAILED;
    };
    leave_link(chain, LOADER_DEVICE_CREATE_INFO, (*link).next);
    let DeviceLink { get_instance_proc_addr, get_device_proc_addr: get_proc, .. } = *link;
    let instance = instance_of(physical).fns.handle();
    let create: vk::PFN_vkCreateDevice =
        transmute(get_instance_proc_addr(instance, c"vkCreateDevice".as_ptr()));
    let queue = [vk::DeviceQueueCreateInfo::default().queue_family_index(0).queue_priorities(&[1.0])];
    let info = (*info).queue_create_infos(&queue);
    let result = create(physical, &info, allocator, out);
    if result != vk::Result::SUCCESS {
        return result;
    }
    let load =
        |name: &CStr| transmute::<vk::PFN_vkVoidFunction, *const c_void>(get_proc(*out, name.as_ptr()));
    let fns = ash::Device::load_with(load, *out);
    let (real, key) = (fns.get_device_queue(0, 0), key_of(*out));
    // The loader stamps only the handles that it hands out: the wrapped ones. The real one is ours to stamp.
    *(vk::Handle::as_raw(real) as *mut Key) = key;
    let device = Device {
        get_proc,
        debug: ext::debug_utils::DeviceFn::load(load),
        swapchain: khr::swapchain::DeviceFn::load(load),
        real,
        queues: Box::new([0, 1].map(|family| Queue { dispatch: AtomicUsize::new(key), family })),
        scheduler: Mutex::new(Scheduler::new(Real { fns: fns.clone(), queue: real }, Mode::from_env())),
        fns,
    };
    lock(&DEVICES).insert(key, Arc::new(device));
    vk::Result::SUCCESS
}

unsafe extern "system" fn destroy_device(handle: vk::Device, allocator: *const vk::AllocationCallbacks<'_>) {
    if handle == vk::Device::null() {
        return;
    }
    let device = lock(&DEVICES).remove(&key_of(handle));
    if let Some(device) = device {
        device.schedule().flush_all();
        (device.fns.fp_v1_0().destroy_device)(handle, allocator);
    }
}

// ---- lookup ----

/// `name => hook as type` for the names of one level; the cast checks the signature.
macro_rules! hooks {
    ($asked:expr, $($name:literal $(| $alias:literal)? => $hook:ident as $signature:ident),+ $(,)?) => {
        match $asked {
            $($name $(| $alias)? => {
                Some(transmute::<vk::$signature, unsafe extern "system" fn()>($hook as vk::$signature))
            })+
            _ => None,
        }
    };
}

unsafe fn instance_hook(name: &[u8]) -> vk::PFN_vkVoidFunction {
    hooks!(name,
        b"vkGetInstanceProcAddr" => get_instance_proc_addr as PFN_vkGetInstanceProcAddr,
        b"vkCreateInstance" => create_instance as PFN_vkCreateInstance,
        b"vkDestroyInstance" => destroy_instance as PFN_vkDestroyInstance,
        b"vkCreateDevice" => create_device as PFN_vkCreateDevice,
        b"vkGetPhysicalDeviceQueueFamilyProperties" =>
            get_queue_families as PFN_vkGetPhysicalDeviceQueueFamilyProperties,
        b"vkGetPhysicalDeviceQueueFamilyProperties2" | b"vkGetPhysicalDeviceQueueFamilyProperties2KHR" =>
            get_queue_families2 as PFN_vkGetPhysicalDeviceQueueFamilyProperties2,
        b"vkGetPhysicalDeviceSurfaceSupportKHR" => get_surface_support as PFN_vkGetPhysicalDeviceSurfaceSupportKHR,
    )
}

unsafe fn device_hook(name: &[u8]) -> vk::PFN_vkVoidFunction {
    hooks!(name,
        b"vkGetDeviceProcAddr" => get_device_proc_addr as PFN_vkGetDeviceProcAddr,
        b"vkDestroyDevice" => destroy_device as PFN_vkDestroyDevice,
        b"vkGetDeviceQueue" => get_device_queue as PFN_vkGetDeviceQueue,
        b"vkGetDeviceQueue2" => get_device_queue2 as PFN_vkGetDeviceQueue2,
        b"vkQueueSubmit" => queue_submit as PFN_vkQueueSubmit,
        b"vkQueueSubmit2" | b"vkQueueSubmit2KHR" => queue_submit2 as PFN_vkQueueSubmit2,
        b"vkQueueWaitIdle" => queue_wait_idle as PFN_vkQueueWaitIdle,
        b"vkDeviceWaitIdle" => device_wait_idle as PFN_vkDeviceWaitIdle,
        b"vkQueueBindSparse" => queue_bind_sparse as PFN_vkQueueBindSparse,
        b"vkQueuePresentKHR" => queue_present as PFN_vkQueuePresentKHR,
        b"vkCreateSemaphore" => create_semaphore as PFN_vkCreateSemaphore,
        b"vkDestroySemaphore" => destroy_semaphore as PFN_vkDestroySemaphore,
        b"vkGetSemaphoreCounterValue" | b"vkGetSemaphoreCounterValueKHR" =>
            get_semaphore_counter_value as PFN_vkGetSemaphoreCounterValue,
        b"vkSignalSemaphore" | b"vkSignalSemaphoreKHR" => signal_semaphore as PFN_vkSignalSemaphore,
        b"vkWaitSemaphores" | b"vkWaitSemaphoresKHR" => wait_semaphores as PFN_vkWaitSemaphores,
        b"vkWaitForFences" => wait_for_fences as PFN_vkWaitForFences,
        b"vkGetFenceStatus" => get_fence_status as PFN_vkGetFenceStatus,
        b"vkCreateCommandPool" => create_command_pool as PFN_vkCreateCommandPool,
        b"vkCreateBuffer" => create_buffer as PFN_vkCreateBuffer,
        b"vkCreateImage" => create_image as PFN_vkCreateImage,
        b"vkGetDeviceBufferMemoryRequirements" | b"vkGetDeviceBufferMemoryRequirementsKHR" =>
            get_device_buffer_memory_requirements as PFN_vkGetDeviceBufferMemoryRequirements,
        b"vkQueueBeginDebugUtilsLabelEXT" => queue_begin_label as PFN_vkQueueBeginDebugUtilsLabelEXT,
        b"vkQueueInsertDebugUtilsLabelEXT" => queue_insert_label as PFN_vkQueueInsertDebugUtilsLabelEXT,
        b"vkQueueEndDebugUtilsLabelEXT" => queue_end_label as PFN_vkQueueEndDebugUtilsLabelEXT,
        b"vkSetDebugUtilsObjectNameEXT" => set_object_name as PFN_vkSetDebugUtilsObjectNameEXT,
        b"vkSetDebugUtilsObjectTagEXT" => set_object_tag as PFN_vkSetDebugUtilsObjectTagEXT,
    )
}

unsafe extern "system" fn get_device_proc_addr(
    handle: vk::Device,
    name: *const c_char,
) -> vk::PFN_vkVoidFunction {
    let next = (device_of(handle).get_proc)(handle, name);
    // What the layers below do not have, this one does not either.
    next.and_then(|next| device_hook(CStr::from_ptr(name).to_bytes()).or(Some(next)))
}

unsafe extern "system" fn get_instance_proc_addr(
    instance: vk::Instance,
    name: *const c_char,
) -> vk::PFN_vkVoidFunction {
    let bytes = CStr::from_ptr(name).to_bytes();
    if let Some(hook) = instance_hook(bytes) {
        return Some(hook);
    }
    if instance == vk::Instance::null() {
        return None;
    }
    let next = (instance_of(instance).get_proc)(instance, name);
    next.and_then(|next| device_hook(bytes).or(Some(next)))
}

/// Where the loader begins.
#[unsafe(no_mangle)]
pub unsafe extern "system" fn vkNegotiateLoaderLayerInterfaceVersion(
    negotiate: *mut NegotiateInterface,
) -> vk::Result {
    let negotiate = &mut *negotiate;
    if negotiate.version < 2 {
        return vk::Result::ERROR_INITIALIZATION_FAILED;
    }
    negotiate.version = 2;
    negotiate.get_instance_proc_addr = get_instance_proc_addr;
    negotiate.get_device_proc_addr = get_device_proc_addr;
    negotiate.get_physical_device_proc_addr = std::ptr::null();
    vk::Result::SUCCESS
}
