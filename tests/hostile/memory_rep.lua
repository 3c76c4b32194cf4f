-- Allocates a thousand megabytes in one call.
-- expect: memory
return ("x"):rep(1e9)
