-- A parameter that was declared under another name.
-- expect: check 4: params.sped does not exist; did you mean 'speed'?
local p = params.declare({ speed = { default = 40, min = 10, max = 100 } })
robot.move(p.sped, p.speed, 1)
