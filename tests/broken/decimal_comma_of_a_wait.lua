-- A comma for the decimal point, where one number is expected.
-- expect: check 4: task.wait: takes 1 argument, got 2
-- help: decimals come after a point: 1.5
task.wait(1,5)
