//! Limits the connections of each address, so that one address leaves room for others.

use std::collections::HashMap;
use std::net::IpAddr;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use tokio::sync::Semaphore;

/// Connections of an address that are served at a time.
const MAX_SERVED: usize = 48;
/// Connections of an address that are open at a time; those that are not served wait.
const MAX_OPEN: usize = 96;

/// The connections of each address that has any.
#[derive(Debug, Clone, Default)]
pub(super) struct AddressShares(Arc<Mutex<HashMap<IpAddr, Share>>>);

#[derive(Debug)]
struct Share {
    open: usize,
    served: Arc<Semaphore>,
}

/// An open connection, which counts until it is dropped.
#[derive(Debug)]
pub(super) struct OpenConnection {
    shares: AddressShares,
    address: IpAddr,
    /// A permit is needed to be served.
    pub(super) served: Arc<Semaphore>,
}

impl AddressShares {
    fn lock(&self) -> MutexGuard<'_, HashMap<IpAddr, Share>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Counts a connection; `None` if the address has as many as it may.
    pub(super) fn open(&self, address: IpAddr) -> Option<OpenConnection> {
        let mut shares = self.lock();
        let new = || Share { open: 0, served: Arc::new(Semaphore::new(MAX_SERVED)) };
        let share = shares.entry(address).or_insert_with(new);
        if share.open >= MAX_OPEN {
            return None;
        }
        share.open += 1;
        Some(OpenConnection { shares: self.clone(), address, served: Arc::clone(&share.served) })
    }
}

impl Drop for OpenConnection {
    fn drop(&mut self) {
        let mut shares = self.shares.lock();
        if let Some(share) = shares.get_mut(&self.address) {
            share.open -= 1;
        }
        shares.retain(|_, share| share.open > 0);
    }
}
