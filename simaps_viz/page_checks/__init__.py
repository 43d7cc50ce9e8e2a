"""What is measured and photographed on a real page: speed, many visitors, pictures. For the programs in apps."""
