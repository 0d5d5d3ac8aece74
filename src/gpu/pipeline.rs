//! Compute pipelines: one compiled shader each, shared by all who ask for the same.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, Weak};

use ash::vk;

use super::device::Gpu;
use super::error::{GpuError, Result};
use super::kinds::BindingKind;
use super::lock::lock;

/// What every Vulkan device grants; shaders may ask for no more.
const MAX_PUSH_BYTES: u32 = 128;

/// A compute pipeline. A clone is another handle to the same pipeline.
#[derive(Clone)]
pub struct ComputePipeline(pub(super) Arc<Inner>);

/// What a pipeline is compiled from: see [`ComputePipeline::new`].
#[derive(Clone, Debug)]
pub struct PipelineDesc {
    /// For messages.
    pub name: &'static str,
    /// SPIR-V.
    pub words: &'static [u32],
    /// Specialisation constants: id, bits.
    pub constants: Vec<(u32, u32)>,
    /// Size of the push constants.
    pub push_bytes: u32,
    /// Bindings of set 0.
    pub bindings: &'static [BindingKind],
}

impl PipelineDesc {
    /// Compiles the pipeline, unless it is there: on any thread.
    pub fn make(&self, gpu: &Gpu) -> Result<ComputePipeline> {
        let PipelineDesc { name, words, constants, push_bytes, bindings } = self;
        ComputePipeline::new(gpu, name, words, constants, *push_bytes, bindings)
    }
}

/// What the driver's compiler made of a shader, in its own words: registers, instructions, ...
#[derive(Clone, Debug, PartialEq)]
pub struct Executable {
    /// The driver's name for it.
    pub name: String,
    /// Lanes that run together.
    pub subgroup_size: u32,
    /// Name and value of each statistic.
    pub statistics: Vec<(String, f64)>,
}

/// What tells pipelines of a device apart; of the words it is enough where they are.
#[derive(PartialEq, Eq, Hash)]
struct Key {
    words: (usize, usize),
    constants: Vec<(u32, u32)>,
    push_bytes: u32,
    bindings: Vec<BindingKind>,
}

/// The pipelines of a device that someone holds; see [`Gpu::shared`].
#[derive(Default)]
struct LivePipelines(Mutex<HashMap<Key, Weak<Inner>>>);

/// A pipeline with its layouts.
pub(super) struct Inner {
    pub gpu: Gpu,
    pub name: String,
    pub set_layout: vk::DescriptorSetLayout,
    layout: vk::PipelineLayout,
    handle: vk::Pipeline,
    push_bytes: u32,
    pub bindings: Vec<BindingKind>,
}

impl ComputePipeline {
    /// A pipeline of SPIR-V `words` (entry point `main`): compiled, unless someone holds one of the same words,
    /// constants and bindings. Takes what the driver needs to compile; any thread may do it.
    ///
    /// `constants` are specialisation constants (id, bits); `push_bytes` is the size of the push
    /// constants, 0 to 128; `bindings` are 0, 1, ... of set 0.
    pub fn new(
        gpu: &Gpu,
        name: &str,
        words: &'static [u32],
        constants: &[(u32, u32)],
        push_bytes: u32,
        bindings: &[BindingKind],
    ) -> Result<ComputePipeline> {
        let key = Key {
            words: (words.as_ptr() as usize, words.len()),
            constants: constants.to_vec(),
            push_bytes,
            bindings: bindings.to_vec(),
        };
        let live = gpu.shared::<LivePipelines>();
        if let Some(pipeline) = lock(&live.0).get(&key).and_then(Weak::upgrade) {
            return Ok(ComputePipeline(pipeline));
        }
        // Not under the lock: others are compiled meanwhile. Two threads that want the same one compile two.
        let pipeline = Arc::new(Inner::new(gpu, name, words, constants, push_bytes, bindings)?);
        let mut live = lock(&live.0);
        live.retain(|_, pipeline| pipeline.strong_count() > 0);
        live.insert(key, Arc::downgrade(&pipeline));
        Ok(ComputePipeline(pipeline))
    }

    /// What the driver's compiler says of the shader; nothing where the device was not opened with
    /// [`super::GpuOptions::statistics`], or cannot tell.
    pub fn statistics(&self) -> Result<Vec<Executable>> {
        let inner = &self.0;
        let Some(device) = &inner.gpu.0.statistics else { return Ok(Vec::new()) };
        let failed = |call: &str, e| GpuError::vulkan(format!("{call} of {}", inner.name), e);
        let text = |s: std::result::Result<&std::ffi::CStr, _>| {
            s.map_or(String::new(), |s: &std::ffi::CStr| s.to_string_lossy().into_owned())
        };
        let info = vk::PipelineInfoKHR::default().pipeline(inner.handle);
        // SAFETY: the pipeline is alive: `self` holds it; the extension is on.
        let executables = unsafe { device.get_pipeline_executable_properties(&info) }
            .map_err(|e| failed("vkGetPipelineExecutablePropertiesKHR", e))?;
        (0u32..)
            .zip(&executables)
            .map(|(index, executable)| {
                let info =
                    vk::PipelineExecutableInfoKHR::default().pipeline(inner.handle).executable_index(index);
                // SAFETY: as above; the pipeline was made with CAPTURE_STATISTICS.
                let all = unsafe { device.get_pipeline_executable_statistics(&info) }
                    .map_err(|e| failed("vkGetPipelineExecutableStatisticsKHR", e))?;
                use vk::PipelineExecutableStatisticFormatKHR as Format;
                // SAFETY: the driver says which member of the union it has written.
                let value = |s: &vk::PipelineExecutableStatisticKHR| unsafe {
                    match s.format {
                        Format::BOOL32 => f64::from(s.value.b32),
                        Format::INT64 => s.value.i64 as f64,
                        // None needs more than 32 bits, and a driver of NVIDIA's leaves others in the upper half.
                        Format::UINT64 => f64::from(s.value.u64 as u32),
                        _ => s.value.f64,
                    }
                };
                Ok(Executable {
                    name: text(executable.name_as_c_str()),
                    subgroup_size: executable.subgroup_size,
                    statistics: all.iter().map(|s| (text(s.name_as_c_str()), value(s))).collect(),
                })
            })
            .collect()
    }

    pub(super) fn handle(&self) -> vk::Pipeline {
        self.0.handle
    }

    pub(super) fn layout(&self) -> vk::PipelineLayout {
        self.0.layout
    }

    pub(super) fn push_bytes(&self) -> u32 {
        self.0.push_bytes
    }
}

impl Inner {
    fn new(
        gpu: &Gpu,
        name: &str,
        words: &[u32],
        constants: &[(u32, u32)],
        push_bytes: u32,
        bindings: &[BindingKind],
    ) -> Result<Inner> {
        assert!(push_bytes <= MAX_PUSH_BYTES, "{name}: {push_bytes} bytes of push constants");
        let device = gpu.device();
        let failed = |call: &str, e| GpuError::vulkan(format!("{call} for {name}"), e);
        // Filled step by step, so that Drop gives back what a failed step leaves.
        let mut inner = Inner {
            gpu: gpu.clone(),
            name: name.to_owned(),
            set_layout: vk::DescriptorSetLayout::null(),
            layout: vk::PipelineLayout::null(),
            handle: vk::Pipeline::null(),
            push_bytes,
            bindings: bindings.to_vec(),
        };
        let mut layout = vk::PipelineLayoutCreateInfo::default();
        let bindings: Vec<_> = (0u32..)
            .zip(bindings)
            .map(|(i, kind)| {
                vk::DescriptorSetLayoutBinding::default()
                    .binding(i)
                    .descriptor_type(kind.descriptor())
                    .descriptor_count(1)
                    .stage_flags(vk::ShaderStageFlags::COMPUTE)
            })
            .collect();
        let set_layouts;
        if !bindings.is_empty() {
            let create = vk::DescriptorSetLayoutCreateInfo::default().bindings(&bindings);
            // SAFETY: the device is alive: `gpu` holds it.
            inner.set_layout = unsafe { device.create_descriptor_set_layout(&create, None) }
                .map_err(|e| failed("vkCreateDescriptorSetLayout", e))?;
            set_layouts = [inner.set_layout];
            layout = layout.set_layouts(&set_layouts);
        }
        let range = [vk::PushConstantRange {
            stage_flags: vk::ShaderStageFlags::COMPUTE,
            offset: 0,
            size: push_bytes,
        }];
        if push_bytes > 0 {
            layout = layout.push_constant_ranges(&range);
        }
        // SAFETY: the device and the set layout are alive.
        inner.layout = unsafe { device.create_pipeline_layout(&layout, None) }
            .map_err(|e| failed("vkCreatePipelineLayout", e))?;

        let module = vk::ShaderModuleCreateInfo::default().code(words);
        // SAFETY: the words are what the shader compiler wrote.
        let module = unsafe { device.create_shader_module(&module, None) }
            .map_err(|e| failed("vkCreateShaderModule", e))?;
        let entries: Vec<_> = (0u32..)
            .zip(constants)
            .map(|(i, (id, _))| vk::SpecializationMapEntry { constant_id: *id, offset: i * 4, size: 4 })
            .collect();
        let data: Vec<u8> = constants.iter().flat_map(|(_, bits)| bits.to_ne_bytes()).collect();
        let specialisation = vk::SpecializationInfo::default().map_entries(&entries).data(&data);
        let stage = vk::PipelineShaderStageCreateInfo::default()
            .stage(vk::ShaderStageFlags::COMPUTE)
            .module(module)
            .name(c"main")
            .specialization_info(&specialisation);
        let flags = match gpu.0.statistics {
            Some(_) => vk::PipelineCreateFlags::CAPTURE_STATISTICS_KHR,
            None => vk::PipelineCreateFlags::empty(),
        };
        let create =
            [vk::ComputePipelineCreateInfo::default().flags(flags).stage(stage).layout(inner.layout)];
        // SAFETY: module and layout are alive until the call returns; afterwards the module is not used.
        let made = unsafe {
            let made = device.create_compute_pipelines(gpu.0.pipeline_cache.handle(), &create, None);
            device.destroy_shader_module(module, None);
            made
        };
        inner.handle = made.map_err(|(_, e)| failed("vkCreateComputePipelines", e))?[0];
        gpu.0.pipeline_cache.note_compiled();
        gpu.name_object(inner.handle, name);
        Ok(inner)
    }
}

impl Drop for Inner {
    fn drop(&mut self) {
        let device = self.gpu.device();
        // SAFETY: this is the last handle; work in flight holds one of its own. Null handles are allowed.
        unsafe {
            device.destroy_pipeline(self.handle, None);
            device.destroy_pipeline_layout(self.layout, None);
            device.destroy_descriptor_set_layout(self.set_layout, None);
        }
    }
}
