-- A default outside of what is allowed.
-- expect: check 3: params.declare: speed: default must be a number from 10 to 100
params.declare({ speed = { default = 400, min = 10, max = 100 } })
