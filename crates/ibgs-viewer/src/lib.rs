//! The interactive viewer. Nothing is here yet: `ibgs` is used from the command line so far.
