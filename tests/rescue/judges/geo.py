# geo.py TRACE OUT: per run: key, n segments
import sys,re,math
done=set();o=open(sys.argv[2],'w')
for l in open(sys.argv[1]):
    if not l.startswith('Y '): continue
    k=l.split()[1]
    if k in done: continue
    done.add(k)
    parts=l.split(' || ')
    W=float(re.search(r'width: ([\d.]+)',parts[0])[1]);D=float(re.search(r'depth: ([\d.]+)',parts[0])[1])
    segs=[(0,0,W,0),(W,0,W,D),(W,D,0,D),(0,D,0,0)]
    for m in re.finditer(r'from: Spot\(\[Coordinate\(([-\d.]+)\), Coordinate\(([-\d.]+)\)\]\), to: Spot\(\[Coordinate\(([-\d.]+)\), Coordinate\(([-\d.]+)\)\]\), thickness: ([\d.]+)',parts[1]):
        x1,y1,x2,y2,t=map(float,m.groups())
        L=math.hypot(x2-x1,y2-y1)
        if L<1e-6: continue
        nx,ny=-(y2-y1)/L*t/2,(x2-x1)/L*t/2
        P=[(x1+nx,y1+ny),(x2+nx,y2+ny),(x2-nx,y2-ny),(x1-nx,y1-ny)]
        for i in range(4): segs.append(P[i]+P[(i+1)%4])
    for m in re.finditer(r'Furniture \{ at: Spot\(\[Coordinate\(([-\d.]+)\), Coordinate\(([-\d.]+)\)\]\), length: ([\d.]+), width: ([\d.]+), height: ([\d.]+), heading_degrees: ([-\d.]+)',l):
        x,y,L,Wd,H,h=map(float,m.groups());h=math.radians(h);c,s=math.cos(h),math.sin(h)
        P=[(x+c*a*L/2-s*b*Wd/2,y+s*a*L/2+c*b*Wd/2) for a,b in ((-1,-1),(1,-1),(1,1),(-1,1))]
        for i in range(4): segs.append(P[i]+P[(i+1)%4])
    for m in re.finditer(r'Post \{ at: Spot\(\[Coordinate\(([-\d.]+)\), Coordinate\(([-\d.]+)\)\]\), radius: ([\d.]+)',l):
        x,y,r=map(float,m.groups());P=[(x-r,y-r),(x+r,y-r),(x+r,y+r),(x-r,y+r)]
        for i in range(4): segs.append(P[i]+P[(i+1)%4])
    o.write('K %s %d\n'%(k,len(segs)))
    for s in segs: o.write('%g %g %g %g\n'%s)
