import sys,math,re,collections
src=open('gain.py').read();g={}
exec('import re,math\n'+src[src.index('def geo'):src.index('C=0.25')],g)
Y={};first={};true={};cur={}
rows=[]
def cast(p,a,segs):
    dx,dy=math.cos(a),math.sin(a);r=99;ty=None
    for x1,y1,x2,y2,t in segs:
        ex,ey=x2-x1,y2-y1;den=dx*ey-dy*ex
        if abs(den)<1e-9: continue
        s=((x1-p[0])*ey-(y1-p[1])*ex)/den;u=((x1-p[0])*dy-(y1-p[1])*dx)/den
        if s>0 and 0<=u<=1 and s<r: r=s;ty=t;n=abs(math.sin(math.atan2(ey,ex)-a))
    return r,ty,n
for l in open(sys.argv[1]):
    w=l.split()
    if not w: continue
    if w[0]=='Y':
        W,D,segs,st=g['geo'](l);S=[s+('wall',) for s in segs]
        for m in re.finditer(r'at: Spot\(\[Coordinate\(([-\d.]+)\), Coordinate\(([-\d.]+)\)\]\)[^}]*?length: ([\d.]+), width: ([\d.]+), height: ([\d.]+)[^}]*?heading_degrees: ([-\d.]+)',l.split(' || ')[2]):
            cx,cy,le,wi,he,hd=map(float,m.groups());a=math.radians(hd);c,s=math.cos(a),math.sin(a)
            P=[(cx+c*i*le/2-s*j*wi/2,cy+s*i*le/2+c*j*wi/2) for i,j in((1,1),(-1,1),(-1,-1),(1,-1))]
            for k in range(4): S.append(P[k]+P[(k+1)%4]+('furn%.1f'%he,))
        Y[w[1]]=S
    elif w[0]=='P': true[w[1]]=tuple(map(float,w[3:6]))
    elif w[0]=='E' and w[3]=='Log' and ' Q ' in l:
        S=Y[w[1]];t=true[w[1]]
        for c in w[w.index('Q')+1:]:
            if c.count(',')!=3 or '…' in c: continue
            a,d,k,low=c.split(',')
            r,ty,n=cast(t[:2],t[2]+float(a),S)
            rows.append((r,float(d),k,ty,n,float(low)))
H=collections.defaultdict(list);hid=collections.Counter();tot=collections.Counter()
for r,d,k,ty,n,low in rows:
    if ty!='wall': continue
    b=round(r*2)/2
    tot[b]+=1
    if k=='h': hid[b]+=1
    else: H[b].append(d/r)
for b in sorted(H):
    v=sorted(H[b])
    if b<6: print('true %.1f m: n %d hidden %.0f%% known ratio p10 %.2f med %.2f p90 %.2f'%(b,tot[b],100*hid[b]/tot[b],v[len(v)//10],v[len(v)//2],v[len(v)*9//10]))
