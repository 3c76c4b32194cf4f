-- Functions cannot be kept from run to run.
-- expect: check 3: store.set: a function cannot be stored
store.set("step", function() end)
