//! The Vulkan instance: its loader, layers and extensions, and what the validation layer says.

use std::ffi::{CStr, CString, c_void};
use std::sync::Mutex;

use ash::{ext, khr, vk};

use super::error::{GpuError, Result};
use super::lock::lock;

const VALIDATION_LAYER: &CStr = c"VK_LAYER_KHRONOS_validation";

/// Validation messages, as the layer's callback leaves them.
#[derive(Default)]
struct Messages {
    list: Mutex<Vec<String>>,
}

/// An instance, with the loader that it came from.
pub(super) struct Instance {
    pub handle: ash::Instance,
    messenger: Option<(ext::debug_utils::Instance, vk::DebugUtilsMessengerEXT)>,
    pub has_debug_utils: bool,
    // The driver calls back with a pointer to it until the instance is gone.
    messages: Box<Messages>,
    /// Keeps the loader library open.
    pub entry: ash::Entry,
}

impl Instance {
    /// `validate`: with the validation layer; `further_layers` come after it; `wanted`: further extensions.
    pub fn new(validate: bool, further_layers: &[String], wanted: &[&'static CStr]) -> Result<Instance> {
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
        if validate {
            layers.push(VALIDATION_LAYER.to_owned());
        }
        layers.extend(further_layers.iter().map(|l| CString::new(l.as_str()).unwrap_or_default()));
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
        let validation_extensions = if validate { offered(Some(VALIDATION_LAYER)) } else { Vec::new() };
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
        if validate && has_debug_utils {
            create = create.push_next(&mut messenger_info);
        }
        // SAFETY: every pointer in `create` is alive in this scope.
        let handle = match unsafe { entry.create_instance(&create, None) } {
            Ok(handle) => handle,
            Err(vk::Result::ERROR_INCOMPATIBLE_DRIVER) => return Err(GpuError::NoDevice),
            Err(e) => return Err(GpuError::vulkan("vkCreateInstance", e)),
        };
        let mut instance = Instance { handle, messenger: None, has_debug_utils, messages, entry };
        if validate && has_debug_utils {
            let debug = ext::debug_utils::Instance::new(&instance.entry, &instance.handle);
            messenger_info.p_next = std::ptr::null();
            // SAFETY: the extension is enabled; `messages` is boxed and lives until after the instance.
            let messenger = unsafe { debug.create_debug_utils_messenger(&messenger_info, None) }
                .map_err(|e| GpuError::vulkan("vkCreateDebugUtilsMessengerEXT", e))?;
            instance.messenger = Some((debug, messenger));
        }
        Ok(instance)
    }

    /// What the validation layer said so far (warnings and errors).
    pub fn messages(&self) -> Vec<String> {
        lock(&self.messages.list).clone()
    }
}

impl Drop for Instance {
    fn drop(&mut self) {
        // SAFETY: the device is gone (it holds its instance and drops it last), so nothing of this instance is in use.
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
    use super::is_of_validation;

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
}
