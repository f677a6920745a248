//! The error of everything that works on the GPU.

/// What can go wrong between us and the GPU.
#[derive(Debug, thiserror::Error)]
pub enum GpuError {
    /// No adapter at all.
    #[error("no GPU adapter was found")]
    NoAdapter,
    /// The requested adapter is not there.
    #[error("no adapter matches `{wanted}`; this machine has: {available}")]
    UnknownAdapter {
        /// What the user asked for.
        wanted: String,
        /// Index and name of each adapter.
        available: String,
    },
    /// The adapter lacks something that every run needs, or every training.
    #[error("adapter `{adapter}` lacks {missing}")]
    Lacking {
        /// Adapter name.
        adapter: String,
        /// The limits, with the needed and the present value.
        missing: String,
    },
    /// The driver refused the device.
    #[error("adapter `{adapter}` refused to open a device: {reason}")]
    Device {
        /// Adapter name.
        adapter: String,
        /// The driver's words.
        reason: String,
    },
    /// A model with levels of detail: the memory holds too few of its chunks.
    #[error("this model needs at least {mib} MiB of device memory")]
    FewChunks {
        /// The least memory, in MiB.
        mib: u64,
    },
    /// A model with levels of detail: its chunks cannot be read.
    #[error("{0}")]
    Levels(String),
    /// A photo cannot be decoded again, after the host's memory did not hold it.
    #[error("{0}")]
    Photo(String),
    /// A buffer would be larger than the device allows.
    #[error("{what} needs {bytes} bytes in one buffer, more than this device allows ({limit})")]
    TooLarge {
        /// What the buffer holds.
        what: &'static str,
        /// Bytes asked for.
        bytes: u64,
        /// The device's limit.
        limit: u64,
    },
    /// The device has no memory left.
    #[error("the GPU has no memory left for {what} ({bytes} bytes)")]
    OutOfMemory {
        /// What the buffer was for.
        what: &'static str,
        /// Bytes asked for.
        bytes: u64,
    },
    /// Results could not be read back.
    #[error("the GPU stopped answering while results were read back: {0}")]
    Readback(String),
    /// The device is lost, or the driver refused some work.
    #[error("the GPU has failed: {0}; the program has to be started again")]
    Failed(String),
}

impl GpuError {
    pub(super) fn no_waiting() -> Self {
        Self::Readback("a browser does not let a program wait for the GPU".to_owned())
    }
}
