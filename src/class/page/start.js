// Starts the page at this address: a learner's, or the teacher's wall.

import(location.pathname === "/wall" ? "./wall.js" : "./workspace.js");
