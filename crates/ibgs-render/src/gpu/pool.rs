//! Scratch memory that is handed out for one forward and backward pass and comes back by itself.

use std::sync::{Arc, Mutex};

/// Returned scratch, ready to be used again.
#[derive(Debug)]
pub struct Pool<T>(Mutex<Vec<T>>);

/// Scratch in use; goes back to its pool when dropped.
#[derive(Debug)]
pub struct Lease<T> {
    value: Option<T>,
    home: Arc<Pool<T>>,
}

impl<T> Default for Pool<T> {
    fn default() -> Self {
        Self(Mutex::default())
    }
}

impl<T> Pool<T> {
    /// A returned value, if there is one.
    pub fn take(&self) -> Option<T> {
        self.0.lock().expect("pool").pop()
    }

    /// Hands a value out.
    pub fn lease(self: &Arc<Self>, value: T) -> Lease<T> {
        Lease { value: Some(value), home: self.clone() }
    }

    /// Hands out a returned value that `fits`; where none does, frees them all and hands out a new one.
    ///
    /// # Errors
    /// Those of `make`.
    pub fn lease_or<E>(
        self: &Arc<Self>,
        fits: impl Fn(&T) -> bool,
        make: impl FnOnce() -> Result<T, E>,
    ) -> Result<Lease<T>, E> {
        let mut returned = self.0.lock().expect("pool");
        let value = match returned.iter().position(fits) {
            Some(at) => returned.swap_remove(at),
            None => {
                returned.clear();
                drop(returned);
                make()?
            }
        };
        Ok(self.lease(value))
    }

    /// Frees everything that is not in use.
    pub fn clear(&self) {
        self.0.lock().expect("pool").clear();
    }
}

impl<T> std::ops::Deref for Lease<T> {
    type Target = T;
    fn deref(&self) -> &T {
        self.value.as_ref().expect("held until dropped")
    }
}

impl<T> std::ops::DerefMut for Lease<T> {
    fn deref_mut(&mut self) -> &mut T {
        self.value.as_mut().expect("held until dropped")
    }
}

impl<T> Drop for Lease<T> {
    fn drop(&mut self) {
        if let Some(value) = self.value.take() {
            self.home.0.lock().expect("pool").push(value);
        }
    }
}
