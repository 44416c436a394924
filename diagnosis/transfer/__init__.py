"""Transfer of a simulated effect onto captured images."""
