//! Compute programs and their buffers.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, Weak};

use ash::vk;

use super::device::Gpu;
use super::error::{GpuError, Result};
use super::kinds::BindingKind;
use super::lock::lock;
use super::memory::Buffer;

/// What every Vulkan device grants; the program may ask for no more.
const MAX_PUSH_BYTES: u32 = 128;

/// A compute program. A clone is another handle to the same program.
#[derive(Clone)]
pub struct ComputePipeline(Arc<Program>);

/// What a program is made of: see [`ComputePipeline::new`].
#[derive(Clone, Debug)]
pub struct Recipe {
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

impl Recipe {
    /// Makes the program, unless it is there: on any thread.
    pub fn make(&self, gpu: &Gpu) -> Result<ComputePipeline> {
        let Recipe { name, words, constants, push_bytes, bindings } = self;
        ComputePipeline::new(gpu, name, words, constants, *push_bytes, bindings)
    }
}

/// What the driver's compiler made of a program, in its own words: registers, instructions, ...
#[derive(Clone, Debug, PartialEq)]
pub struct Executable {
    /// The driver's name for it.
    pub name: String,
    /// Lanes that run together.
    pub subgroup_size: u32,
    /// Name and value of each statistic.
    pub statistics: Vec<(String, f64)>,
}

/// What tells programs of a device apart; of the words it is enough where they are.
#[derive(PartialEq, Eq, Hash)]
struct Kind {
    words: (usize, usize),
    constants: Vec<(u32, u32)>,
    push_bytes: u32,
    bindings: Vec<BindingKind>,
}

/// The programs of a device that someone holds; see [`Gpu::shared`].
#[derive(Default)]
struct Programs(Mutex<HashMap<Kind, Weak<Program>>>);

struct Program {
    gpu: Gpu,
    name: String,
    set_layout: vk::DescriptorSetLayout,
    layout: vk::PipelineLayout,
    handle: vk::Pipeline,
    push_bytes: u32,
    bindings: Vec<BindingKind>,
}

impl ComputePipeline {
    /// A program of SPIR-V `words` (entry point `main`): made, unless someone holds one of the same words, constants
    /// and bindings. Takes what the driver needs to compile; any thread may do it.
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
        let kind = Kind {
            words: (words.as_ptr() as usize, words.len()),
            constants: constants.to_vec(),
            push_bytes,
            bindings: bindings.to_vec(),
        };
        let programs = gpu.shared::<Programs>();
        if let Some(program) = lock(&programs.0).get(&kind).and_then(Weak::upgrade) {
            return Ok(ComputePipeline(program));
        }
        // Not under the lock: others are made meanwhile. Two threads that want the same one make two.
        let program = Arc::new(Program::new(gpu, name, words, constants, push_bytes, bindings)?);
        let mut programs = lock(&programs.0);
        programs.retain(|_, program| program.strong_count() > 0);
        programs.insert(kind, Arc::downgrade(&program));
        Ok(ComputePipeline(program))
    }

    /// Ties `buffers` to bindings 0, 1, ... of this program, whole.
    ///
    /// # Panics
    /// When there are not as many as the program declares.
    pub fn binding(&self, buffers: &[&Buffer]) -> Result<Binding> {
        let program = &self.0;
        assert_eq!(buffers.len(), program.bindings.len(), "buffers of {}", program.name);
        let device = program.gpu.device();
        let failed = |call: &str, e| GpuError::vulkan(format!("{call} for {}", program.name), e);
        let sizes: Vec<_> = program
            .bindings
            .iter()
            .map(|kind| vk::DescriptorPoolSize { ty: kind.descriptor(), descriptor_count: 1 })
            .collect();
        let create = vk::DescriptorPoolCreateInfo::default().max_sets(1).pool_sizes(&sizes);
        // SAFETY: the device is alive: the program holds it.
        let pool = unsafe { device.create_descriptor_pool(&create, None) }
            .map_err(|e| failed("vkCreateDescriptorPool", e))?;
        let buffers: Vec<Buffer> = buffers.iter().map(|&b| b.clone()).collect();
        let mut set = BoundSet {
            pool,
            set: vk::DescriptorSet::null(),
            pipeline: self.clone(),
            buffers,
            views: Vec::new(),
        };
        let layouts = [program.set_layout];
        let allocate = vk::DescriptorSetAllocateInfo::default().descriptor_pool(pool).set_layouts(&layouts);
        // SAFETY: pool and layout are alive and used by this thread alone.
        set.set = unsafe { device.allocate_descriptor_sets(&allocate) }
            .map_err(|e| failed("vkAllocateDescriptorSets", e))?[0];
        let infos: Vec<_> = set
            .buffers
            .iter()
            .map(|b| [vk::DescriptorBufferInfo { buffer: b.handle(), offset: 0, range: vk::WHOLE_SIZE }])
            .collect();
        for (buffer, kind) in set.buffers.iter().zip(&program.bindings) {
            let mut view = vk::BufferView::null();
            if *kind == BindingKind::Texels {
                let create = vk::BufferViewCreateInfo::default()
                    .buffer(buffer.handle())
                    .format(vk::Format::R32_UINT)
                    .range(vk::WHOLE_SIZE);
                // SAFETY: the buffer is alive and was made for such views.
                view = unsafe { device.create_buffer_view(&create, None) }
                    .map_err(|e| failed("vkCreateBufferView", e))?;
            }
            set.views.push([view]);
        }
        let writes: Vec<_> = (0u32..)
            .zip(infos.iter().zip(&program.bindings).zip(&set.views))
            .map(|(i, ((info, kind), view))| {
                vk::WriteDescriptorSet::default()
                    .dst_set(set.set)
                    .dst_binding(i)
                    .descriptor_type(kind.descriptor())
                    .buffer_info(info)
                    .texel_buffer_view(view)
            })
            .collect();
        // SAFETY: the set is new, so no work uses it; the buffers live as long as the set.
        unsafe { device.update_descriptor_sets(&writes, &[]) };
        Ok(Binding(Arc::new(set)))
    }

    /// What the driver's compiler says of the program; nothing where the device was not opened with
    /// [`super::GpuOptions::statistics`], or cannot tell.
    pub fn statistics(&self) -> Result<Vec<Executable>> {
        let program = &self.0;
        let Some(device) = &program.gpu.0.statistics else { return Ok(Vec::new()) };
        let failed = |call: &str, e| GpuError::vulkan(format!("{call} of {}", program.name), e);
        let text = |s: std::result::Result<&std::ffi::CStr, _>| {
            s.map_or(String::new(), |s: &std::ffi::CStr| s.to_string_lossy().into_owned())
        };
        let info = vk::PipelineInfoKHR::default().pipeline(program.handle);
        // SAFETY: the pipeline is alive: `self` holds it; the extension is on.
        let executables = unsafe { device.get_pipeline_executable_properties(&info) }
            .map_err(|e| failed("vkGetPipelineExecutablePropertiesKHR", e))?;
        (0u32..)
            .zip(&executables)
            .map(|(index, executable)| {
                let info =
                    vk::PipelineExecutableInfoKHR::default().pipeline(program.handle).executable_index(index);
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

impl Program {
    fn new(
        gpu: &Gpu,
        name: &str,
        words: &[u32],
        constants: &[(u32, u32)],
        push_bytes: u32,
        bindings: &[BindingKind],
    ) -> Result<Program> {
        assert!(push_bytes <= MAX_PUSH_BYTES, "{name}: {push_bytes} bytes of push constants");
        let device = gpu.device();
        let failed = |call: &str, e| GpuError::vulkan(format!("{call} for {name}"), e);
        // Filled step by step, so that Drop gives back what a failed step leaves.
        let mut program = Program {
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
            program.set_layout = unsafe { device.create_descriptor_set_layout(&create, None) }
                .map_err(|e| failed("vkCreateDescriptorSetLayout", e))?;
            set_layouts = [program.set_layout];
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
        program.layout = unsafe { device.create_pipeline_layout(&layout, None) }
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
            [vk::ComputePipelineCreateInfo::default().flags(flags).stage(stage).layout(program.layout)];
        // SAFETY: module and layout are alive until the call returns; afterwards the module is not used.
        let made = unsafe {
            let made = device.create_compute_pipelines(gpu.0.pipeline_cache.handle(), &create, None);
            device.destroy_shader_module(module, None);
            made
        };
        program.handle = made.map_err(|(_, e)| failed("vkCreateComputePipelines", e))?[0];
        gpu.0.pipeline_cache.note_compiled();
        gpu.name_object(program.handle, name);
        Ok(program)
    }
}

impl Drop for Program {
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

/// Buffers tied to a program; holds the buffers. A clone is another handle.
#[derive(Clone)]
pub struct Binding(Arc<BoundSet>);

struct BoundSet {
    pool: vk::DescriptorPool,
    set: vk::DescriptorSet,
    pipeline: ComputePipeline,
    buffers: Vec<Buffer>,
    /// Of the buffers that are seen as texels; null for others.
    views: Vec<[vk::BufferView; 1]>,
}

/// Bindings of the passes of one frame in flight, kept for the next time. A set is never written again, so it serves as
/// long as program and buffers are the same.
#[derive(Default)]
pub struct BindingCache {
    now: Vec<Binding>,
    before: Vec<Binding>,
}

impl BindingCache {
    /// A frame begins. What the last one had no use for is let go, and so are its buffers.
    pub fn begin(&mut self) {
        self.before = std::mem::take(&mut self.now);
    }

    /// [`ComputePipeline::binding`], made where this frame or the last one had none.
    pub fn get(&mut self, program: &ComputePipeline, buffers: &[&Buffer]) -> Result<Binding> {
        let known = self.now.iter().chain(&self.before).find(|binding| binding.ties(program, buffers));
        let binding = match known {
            Some(binding) => binding.clone(),
            None => program.binding(buffers)?,
        };
        self.now.push(binding.clone());
        Ok(binding)
    }
}

impl Binding {
    /// Whether it ties these buffers to this program.
    fn ties(&self, program: &ComputePipeline, buffers: &[&Buffer]) -> bool {
        let BoundSet { pipeline, buffers: own, .. } = &*self.0;
        let same = |(a, b): (&Buffer, &&Buffer)| a.is(b);
        Arc::ptr_eq(&pipeline.0, &program.0)
            && own.len() == buffers.len()
            && own.iter().zip(buffers).all(same)
    }

    pub(super) fn set(&self) -> vk::DescriptorSet {
        self.0.set
    }
}

impl Drop for BoundSet {
    fn drop(&mut self) {
        let device = self.pipeline.0.gpu.device();
        // SAFETY: this is the last handle; work in flight holds one of its own. Null handles are allowed.
        unsafe {
            device.destroy_descriptor_pool(self.pool, None);
            self.views.iter().flatten().for_each(|view| device.destroy_buffer_view(*view, None));
        }
    }
}
