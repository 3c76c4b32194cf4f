-- Names keep to small letters.
-- expect: check 3: unknown name 'Robot'; did you mean 'robot'?
Robot.stop()
