//! The only unsafe code: device, memory, timelines, pipelines.
